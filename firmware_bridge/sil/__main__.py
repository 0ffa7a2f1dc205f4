"""``python -m firmware_bridge.sil`` is edge-sil."""

import sys

from firmware_bridge.sil.edge_sil import main

if __name__ == "__main__":
    sys.exit(main())
