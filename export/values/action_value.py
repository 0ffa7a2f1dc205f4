"""How much better than the policy's own an action is, by a robot's observation: a network and its file."""

import io
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec.structs import asdict

from edge_runtime.common.arrays import Floats
from edge_runtime.common.durable_file import replace_durably
from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import ConfigError

LARGEST_FILE = 1 << 20
"""Bytes."""
MAKE_IT = "make it with python -m benchmarks values"


Weights = npt.NDArray[np.float32]


class ActionValue(msgspec.Struct, frozen=True):
    """A(o, a) = w3 silu(w2 silu(w1 [o, a] + b1) + b2), in standard deviations of what was seen.

    Observations are normalised by the first layer, as in `edge_runtime.policy.weights`.
    """

    policy: str
    """Digest of the policy whose actions it judges."""
    observation: Weights
    """(O, H1)"""
    action: Weights
    """(d, H1)"""
    bias: Weights
    """(H1,)"""
    hidden: Weights
    """(H1, H2)"""
    hidden_bias: Weights
    """(H2,)"""
    output: Weights
    """(H2,)"""

    def slopes(self, observation: npt.NDArray[np.float32]) -> Callable[[Floats], Floats]:
        """Return dA/da (B, d) as a function of B actions (B, d), at observations (B, O)."""
        seen = observation.astype(np.float64) @ self.observation + self.bias

        def slopes(action: Floats) -> Floats:
            first = seen + action @ self.action
            second = _silu(first) @ self.hidden + self.hidden_bias
            back = (self.output * _silu_slope(second)) @ self.hidden.T
            result: Floats = (back * _silu_slope(first)) @ self.action.T
            return result

        return slopes


def save_value(path: Path, value: ActionValue) -> None:
    """Write an ``.npz`` file, at once.

    Raises:
        ConfigError: if it cannot be written.
    """
    content = io.BytesIO()
    np.savez(content, **{name: np.asarray(found) for name, found in asdict(value).items()})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_durably(path, content.getvalue())
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror})") from error


def load_value(path: Path, policy: str) -> ActionValue:
    """Read what `save_value` wrote.

    Args:
        path: of the file.
        policy: digest of the policy whose actions it is to judge.

    Raises:
        ConfigError: if it is missing, damaged, or of another policy, and says how to make it.
    """
    try:
        with np.load(io.BytesIO(read_regular(path, LARGEST_FILE)), allow_pickle=False) as file:
            found = {name: file[name] for name in ActionValue.__struct_fields__}
        value = ActionValue(**{**found, "policy": str(found["policy"])})
        slopes = value.slopes(np.zeros((1, len(value.observation)), np.float32))(
            np.zeros((1, len(value.action)))
        )
    except Exception as error:  # whatever numpy and zipfile make of a file that is no archive of these
        raise ConfigError(f"{path}: holds no value of actions: {MAKE_IT}") from error
    if value.policy != policy or not np.isfinite(slopes).all():
        raise ConfigError(f"{path}: judges another policy than {policy}: {MAKE_IT}")
    return value


def _silu(x: Floats) -> Floats:
    return x * _sigmoid(x)


def _silu_slope(x: Floats) -> Floats:
    share = _sigmoid(x)
    return share * (1.0 + x * (1.0 - share))


def _sigmoid(x: Floats) -> Floats:
    result: Floats = 0.5 + 0.5 * np.tanh(0.5 * x)
    return result
