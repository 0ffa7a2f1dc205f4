"""``policy.npz``: the arrays of `FlowWeights`, never pickled, the same bytes for the same weights."""

import io
import re
import struct
import zipfile
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Array
from edge_runtime.errors import BundleError
from edge_runtime.policy.manifest import Manifest
from edge_runtime.policy.schema import MAX_FREQUENCIES
from edge_runtime.policy.weights import FlowWeights

_NPY: Final = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '(?P<type>[<>|][biuf]\d{1,2})', "
    rb"'fortran_order': False, 'shape': \((?P<shape>(?:\d{1,9},? ?){0,4})\), \} *\n",
    re.DOTALL,
)
"""The head of an array of numbers as numpy writes it; whatever else there is, is not evaluated."""
_NPY_PREFIX: Final = struct.Struct("<8sH")
_ENCRYPTED: Final = 1
_UNREADABLE: Final = (
    ValueError,
    TypeError,
    EOFError,
    OSError,
    NotImplementedError,
    struct.error,
    zipfile.BadZipFile,
)
"""What zipfile and numpy raise for bytes that are not what they seem."""


def pack_weights(weights: FlowWeights) -> bytes:
    """Write the weights as an uncompressed npz without time stamps."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in _named_arrays(weights).items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as member:  # dated 1980, not today
                np.lib.format.write_array(member, np.ascontiguousarray(array), allow_pickle=False)
    return buffer.getvalue()


def unpack_weights(content: bytes, manifest: Manifest, source: str) -> FlowWeights:
    """Read the weights that the manifest describes.

    Args:
        content: bytes of an npz file.
        manifest: of runtime ``numpy``; states activation, layer sizes and prior.
        source: the file to name in errors.

    Raises:
        BundleError: names the array whose presence, type, shape or values do not fit.
    """
    network = manifest.network
    if network is None:
        raise BundleError(f"{source}: the manifest describes no network for these weights")
    arrays = _read_arrays(content, source)
    frequencies = arrays["time_frequency"].size if "time_frequency" in arrays else 0
    if frequencies > MAX_FREQUENCIES:
        raise BundleError(f"{source}: has {frequencies} frequencies of flow time, at most {MAX_FREQUENCIES}")
    _check_arrays(arrays, _shapes(manifest, network.hidden, frequencies), source)
    return FlowWeights(
        activation=network.activation,
        action=arrays["action"],
        observation=arrays["observation"],
        time=arrays["time"],
        time_frequency=arrays["time_frequency"],
        time_phase=arrays["time_phase"],
        matrices=tuple(arrays[f"matrix_{layer}"] for layer in range(1, len(network.hidden) + 1)),
        biases=tuple(arrays[f"bias_{layer}"] for layer in range(len(network.hidden) + 1)),
        prior_std=network.prior_std,
    )


def _named_arrays(weights: FlowWeights) -> dict[str, Array]:
    return {
        "action": weights.action,
        "observation": weights.observation,
        "time": weights.time,
        "time_frequency": weights.time_frequency,
        "time_phase": weights.time_phase,
        **{f"matrix_{layer}": matrix for layer, matrix in enumerate(weights.matrices, start=1)},
        **{f"bias_{layer}": bias for layer, bias in enumerate(weights.biases)},
    }


def _read_arrays(content: bytes, source: str) -> dict[str, npt.NDArray[Any]]:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            require_plain(members, len(content))
            return {member.filename.removesuffix(".npy"): _array(archive.read(member)) for member in members}
    except _UNREADABLE as error:
        raise BundleError(f"{source}: not a readable npz archive of plain arrays ({error})") from error


def require_plain(members: Sequence[zipfile.ZipInfo], size: int) -> None:
    """Refuse what would unpack to more than the archive itself."""
    for member in members:
        if member.compress_type != zipfile.ZIP_STORED or member.flag_bits & _ENCRYPTED:
            raise ValueError(f"{member.filename} is compressed or encrypted")
    if sum(member.file_size for member in members) > size:
        raise ValueError("its members are larger than itself")


def _array(content: bytes) -> npt.NDArray[Any]:
    head = _NPY.match(content)
    if head is None or head.end() != _NPY_PREFIX.size + _NPY_PREFIX.unpack_from(content)[1]:
        raise ValueError("a member does not begin as an array of numbers")
    shape = [int(size) for size in head["shape"].replace(b",", b" ").split()]
    return np.frombuffer(content, np.dtype(head["type"].decode()), offset=head.end()).reshape(shape).copy()


def _shapes(manifest: Manifest, hidden: tuple[int, ...], frequencies: int) -> dict[str, tuple[int, ...]]:
    widths = (*hidden, manifest.action_dim)
    return {
        "action": (manifest.action_dim, hidden[0]),
        "observation": (manifest.observation_dim, hidden[0]),
        "time": (1 + frequencies, hidden[0]),
        "time_frequency": (frequencies,),
        "time_phase": (frequencies,),
        **{f"matrix_{layer}": widths[layer - 1 : layer + 1] for layer in range(1, len(widths))},
        **{f"bias_{layer}": (width,) for layer, width in enumerate(widths)},
    }


def _check_arrays(
    arrays: dict[str, npt.NDArray[Any]], shapes: dict[str, tuple[int, ...]], source: str
) -> None:
    if arrays.keys() != shapes.keys():
        found, wanted = ", ".join(sorted(arrays)), ", ".join(sorted(shapes))
        raise BundleError(f"{source}: has arrays {found}; the manifest's layers need {wanted}")
    for name, shape in shapes.items():
        array = arrays[name]
        if array.dtype != np.float32 or array.shape != shape:
            raise BundleError(
                f"{source}: array {name} is {array.dtype} {array.shape}, "
                f"the manifest's fields and layers need float32 {shape}"
            )
        if not np.isfinite(array).all():
            raise BundleError(f"{source}: array {name} holds values that are not finite")
