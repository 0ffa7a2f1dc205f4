"""``python -m edge_runtime.tools.pose`` is edge-pose."""

from edge_runtime.common.commands import edge_pose

if __name__ == "__main__":
    edge_pose()
