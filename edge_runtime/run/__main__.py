"""``python -m edge_runtime.run`` is edge-run."""

from edge_runtime.common.commands import edge_run

if __name__ == "__main__":
    edge_run()
