"""``python -m edge_runtime.completion`` prints shell completion."""

import sys

from edge_runtime.completion.completion import main

if __name__ == "__main__":
    sys.exit(main())
