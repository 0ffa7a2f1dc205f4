"""``python -m edge_runtime.run`` is edge-run."""

import sys

from edge_runtime.run.edge_run import main

if __name__ == "__main__":
    sys.exit(main())
