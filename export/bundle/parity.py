"""Do all forms of a policy compute the same? The check that stands between training and a robot."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.errors import BundleError
from edge_runtime.observation import Ranges
from edge_runtime.policy.agreement import TOLERANCE, largest_difference
from export.bundle.facts import Facts

SAMPLES = 1000


@dataclass(frozen=True)
class Inputs:
    """B inputs of a velocity field, in float64 but representable in float32."""

    action: Floats
    """(B, d)."""
    tau: Floats
    """(B,)."""
    observation: Floats
    """(B, O)."""

    def arrays(self) -> tuple[Floats, Floats, Floats]:
        """Action, tau and observation, in the order that every policy takes them."""
        return self.action, self.tau, self.observation

    def select(self, rows: npt.NDArray[np.intp]) -> "Inputs":
        """The inputs with the given numbers."""
        return Inputs(self.action[rows], self.tau[rows], self.observation[rows])


def random_inputs(facts: Facts, count: int = SAMPLES, seed: int = 0) -> Inputs:
    """Draw actions from N(0, 1.5^2), tau from [0, 1], observations from where robots drive."""
    generator = np.random.default_rng(seed)
    fields = []
    for field in facts.observation:
        if isinstance(field, Ranges):
            fields.append(generator.uniform(0.0, facts.body.lidar_range_m, (count, field.size)))
        else:
            fields.append(generator.normal(0.0, 1.0, (count, field.size)))
    return Inputs(
        action=_representable(generator.normal(0.0, 1.5, (count, len(facts.action)))),
        tau=_representable(generator.uniform(0.0, 1.0, count)),
        observation=_representable(np.concatenate(fields, axis=1)),
    )


def require_parity(results: Mapping[str, npt.NDArray[np.floating]]) -> float:
    """Compare what several forms computed from the same inputs.

    Args:
        results: (1 + d, B, d) velocity and derivatives of each named form.

    Returns:
        The largest difference between any two forms.

    Raises:
        BundleError: names two forms that differ by more than 1e-5 and by how much.
    """
    largest = 0.0
    for (first, a), (second, b) in combinations(results.items(), 2):
        for what, rows in (("velocity", slice(0, 1)), ("jacobian", slice(1, None))):
            difference = largest_difference(b[rows], a[rows])
            if not difference <= TOLERANCE:  # written so that NaN is refused
                raise BundleError(
                    f"{what} of {first} and {second} differ by {difference:.2g}, more than {TOLERANCE:g}: "
                    "no bundle is written"
                )
            largest = max(largest, difference)
    return largest


def _representable(array: Floats) -> Floats:
    return array.astype(np.float32).astype(np.float64)
