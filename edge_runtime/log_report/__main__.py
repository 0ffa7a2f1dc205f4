"""``python -m edge_runtime.log_report`` is edge-report."""

import sys

from edge_runtime.log_report.command import main

if __name__ == "__main__":
    sys.exit(main())
