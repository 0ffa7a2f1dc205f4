"""Brings a bundle of an earlier format to today's: another manifest, the same policy."""

import shutil
from collections.abc import Callable
from pathlib import Path

from msgspec.structs import replace

from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import ConfigError
from edge_runtime.observation import ObservationField
from edge_runtime.policy.bundle import LARGEST_MANIFEST, MANIFEST_FILE, Bundle, load_bundle
from edge_runtime.policy.manifest import BUNDLE_FORMAT, Manifest, Training
from edge_runtime.policy.signature import SIGNATURE_FILE
from export.bundle.writer import bundle_draft, write_manifest


def upgrade_bundle(directory: Path, fields_of: Callable[[Training], tuple[ObservationField, ...]]) -> str:
    """Write a bundle's manifest anew.

    Args:
        directory: the bundle's.
        fields_of: what a policy observes by its training; nothing where that is not known.

    Returns:
        A line that says what was done.

    Raises:
        BundleError: if it is no bundle that loads.
        ConfigError: if it is of today's format already, or cannot be written.
    """
    bundle = load_bundle(directory)
    if BUNDLE_FORMAT.encode() in read_regular(directory / MANIFEST_FILE, LARGEST_MANIFEST):
        raise ConfigError(f"{directory}: is of format {BUNDLE_FORMAT} already")
    again = replace_manifest(bundle, _with_sources(bundle.manifest, fields_of))
    return f"{directory}: manifest written anew in {BUNDLE_FORMAT}, the policy is the same" + again


def replace_manifest(bundle: Bundle, manifest: Manifest) -> str:
    """Give a bundle a manifest that supersedes its own; what does not load is not written.

    Returns:
        What is left to do, to be said after what was done; empty if nothing is.

    Raises:
        BundleError: if no robot could run it.
        ConfigError: if it cannot be written.
    """
    directory, earlier = bundle.directory, (*bundle.manifest.supersedes, bundle.sha256)
    signed = (directory / SIGNATURE_FILE).exists()
    with bundle_draft(directory, force=True) as draft:
        for file in manifest.files:
            shutil.copyfile(directory / file, draft / file)
        write_manifest(draft, replace(manifest, supersedes=earlier))
        load_bundle(draft)
    return "; its signature was of the old one: sign it again with --sign" if signed else ""


def _with_sources(
    manifest: Manifest, fields_of: Callable[[Training], tuple[ObservationField, ...]]
) -> Manifest:
    """The manifest with the sources of its training's fields, where they are the same fields."""
    fields = fields_of(manifest.training) if manifest.training else ()
    stated = [(field.name, field.size, field.unit) for field in manifest.observation]
    if stated != [(field.name, field.size, field.unit) for field in fields]:
        return manifest
    return replace(manifest, observation=fields)
