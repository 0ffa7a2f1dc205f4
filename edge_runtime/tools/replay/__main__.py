"""``python -m edge_runtime.tools.replay`` is edge-replay."""

from edge_runtime.common.commands import edge_replay

if __name__ == "__main__":
    edge_replay()
