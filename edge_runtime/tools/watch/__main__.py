"""``python -m edge_runtime.tools.watch`` is edge-watch."""

from edge_runtime.common.commands import edge_watch

if __name__ == "__main__":
    edge_watch()
