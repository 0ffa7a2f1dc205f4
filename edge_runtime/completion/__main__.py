"""``python -m edge_runtime.completion`` prints shell completion."""

from edge_runtime.common.commands import launch

if __name__ == "__main__":
    launch("completion", "edge_runtime.completion.completion")
