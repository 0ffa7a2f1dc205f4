"""``python -m edge_runtime.watch`` is edge-watch."""

import sys

from edge_runtime.watch.command import main

if __name__ == "__main__":
    sys.exit(main())
