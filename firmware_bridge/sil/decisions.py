"""When a runtime decided, and on which pose: from its own log."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from edge_runtime.scene import Floats


class Decisions(NamedTuple):
    """One robot's ticks, in order; monotonic seconds."""

    decided_s: Floats
    used_pose_s: Floats


NONE = Decisions(np.empty(0), np.empty(0))


def read_decisions(folder: Path) -> Decisions:
    """Return what the log in a folder says; nothing where there is none."""
    return NONE
