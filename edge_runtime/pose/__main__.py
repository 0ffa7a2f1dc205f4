"""``python -m edge_runtime.pose`` is edge-pose."""

import sys

from edge_runtime.pose.command import main

if __name__ == "__main__":
    sys.exit(main())
