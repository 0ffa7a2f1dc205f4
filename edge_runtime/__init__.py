"""The robot side: observe, sample a flow policy guided by execution-time objectives, command."""

from typing import Final

__version__: Final = "0.1.0"
