"""What one robot knows of another, and what it tells it."""

from collections.abc import Callable

from msgspec.structs import replace

from edge_runtime.messages import RobotState, Teammate, Vector
from edge_runtime.network.session import Session, random_nonce
from edge_runtime.network.team_wire import Frame, GuideVersions


class Peer(Session[Frame]):
    """One robot's session with another.

    Args:
        robot_id: of the other.
        nonce: draws challenges.
    """

    def __init__(self, robot_id: int, nonce: Callable[[], int] = random_nonce) -> None:
        super().__init__(nonce)
        self.robot_id = robot_id
        self.doubt = ""
        """Why it is kept out, if it is."""

    def accept(self, frame: Frame, arrival_s: float) -> None:
        """Take in a frame that passed every check."""
        super().accept(frame, arrival_s)
        self.doubt = ""

    def teammate(self, now_s: float) -> Teammate:
        """Return its newest state, stamped in our clock; there must be one."""
        if self.newest is None:
            raise LookupError(f"robot {self.robot_id} has not been heard")
        state = replace(self.newest.state, stamp_s=self.measured_s)
        return Teammate(state, self.newest.intended_action, self.age_s(now_s))

    def frame(
        self,
        boot_id: int,
        sequence: int,
        state: RobotState,
        action: Vector,
        tick: int,
        versions: GuideVersions,
        *,
        listens: bool,
    ) -> Frame:
        """Return our next frame to this robot."""
        return Frame(
            self.robot_id,
            boot_id,
            sequence,
            self.challenge,
            self.answer,
            state,
            action,
            listens,
            tick,
            versions,
        )
