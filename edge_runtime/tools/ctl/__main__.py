"""``python -m edge_runtime.tools.ctl`` is edge-ctl."""

from edge_runtime.common.commands import edge_ctl

if __name__ == "__main__":
    edge_ctl()
