"""The one exception family. Every message is one line that names the culprit and the remedy."""


class EdgeError(Exception):
    """Base of every error this project raises on purpose; commands print it and exit with code 2."""


class ConfigError(EdgeError):
    """A flag, TOML file or key is missing, of the wrong type, out of range or contradictory."""


class AddressTakenError(ConfigError):
    """Another process holds the network address."""


class BundleError(EdgeError):
    """A policy bundle is missing, damaged, or does not fit the robot that loads it."""


class PolicyError(EdgeError):
    """A policy cannot be evaluated: shapes differ, or the runtime it needs is not installed."""


class BridgeError(EdgeError):
    """The link to the robot's firmware cannot be opened or has failed."""


class FailedError(EdgeError):
    """What a command had begun did not succeed: it ends with exit code 1, not 2."""


class GradientError(EdgeError):
    """An objective's slope disagrees with the finite differences of its own cost."""
