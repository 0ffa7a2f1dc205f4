"""``python -m edge_runtime.tools.report`` is edge-report."""

import sys

from edge_runtime.tools.report.edge_report import main

if __name__ == "__main__":
    sys.exit(main())
