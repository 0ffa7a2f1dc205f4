"""``python -m edge_runtime.tools.watch`` is edge-watch."""

import sys

from edge_runtime.tools.watch.edge_watch import main

if __name__ == "__main__":
    sys.exit(main())
