"""Whether a robot may run a bundle: signed by whom its fleet trusts, and no older than what it has run."""

from edge_runtime.config.fleet import Fleet
from edge_runtime.policy.bundle import Bundle
from edge_runtime.policy.signature import check_signature
from edge_runtime.policy.version_ledger import VersionLedger


def require_trusted(bundle: Bundle, fleet: Fleet, robot_id: int, *, allow_rollback: bool = False) -> None:
    """Refuse a bundle that a fleet's robot must not run; any passes where the fleet names no keys.

    Raises:
        BundleError: if it is unsigned, changed, signed by somebody else, or older than what was run.
        ConfigError: if what is needed to tell is missing.
    """
    if fleet.team.trusted_keys:
        signature = check_signature(bundle.directory, bundle.sha256, fleet.team.trusted_keys)
        ledger = VersionLedger(robot_id)
        ledger.check(bundle.manifest.name, signature.version, allow_rollback=allow_rollback)


def note_run(bundle: Bundle, fleet: Fleet, robot_id: int) -> None:
    """Remember that a fleet's robot runs a bundle which passed `require_trusted`; raises as that does."""
    if fleet.team.trusted_keys:
        signature = check_signature(bundle.directory, bundle.sha256, fleet.team.trusted_keys)
        VersionLedger(robot_id).note(bundle.manifest.name, signature.version)
