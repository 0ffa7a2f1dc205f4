"""The rows of ``steering.json``: one way to follow a scene's objectives, by one seed's policy."""

import msgspec

from benchmarks.paper.settings import Guided
from benchmarks.paper.steering.judge import SceneJudge


class Asked(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a row is to answer."""

    scene: str
    """A key of `SCENES`."""
    way: str
    """A key of `ways`."""
    settings: Guided
    seed: int
    """Of the policy's training."""
    episodes: int


class SteeringRow(Asked, frozen=True, kw_only=True):
    """Shares in percent, of the episodes or, for ``broken``, of their steps."""

    success: float
    """Arrived, on the right side, and every objective to be kept was."""
    arrived: float
    """On the right side, whatever was kept."""
    broken: tuple[float, ...]
    """For each objective to be kept, the steps in which it was violated by any robot."""
    policy: str
    """Digest of its manifest."""
    commit: str

    @classmethod
    def of(cls, asked: Asked, policy: str, commit: str, judge: SceneJudge) -> "SteeringRow":
        """Sum a judge's episodes up."""
        return cls(
            **msgspec.structs.asdict(asked),
            success=100.0 * float(judge.satisfied().mean()),
            arrived=100.0 * float(judge.arrived().mean()),
            broken=tuple((100.0 * judge.broken().mean(0)).tolist()),
            policy=policy,
            commit=commit,
        )

    @property
    def asked(self) -> Asked:
        """The question that this row answers."""
        return Asked(**{name: getattr(self, name) for name in Asked.__struct_fields__})
