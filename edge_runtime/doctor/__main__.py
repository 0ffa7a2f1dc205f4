"""``python -m edge_runtime.doctor`` is edge-doctor."""

import sys

from edge_runtime.doctor.edge_doctor import main

if __name__ == "__main__":
    sys.exit(main())
