"""``python -m edge_runtime.tools.pose`` is edge-pose."""

import sys

from edge_runtime.tools.pose.edge_pose import main

if __name__ == "__main__":
    sys.exit(main())
