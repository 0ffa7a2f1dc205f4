"""``python -m firmware_bridge.sil`` is edge-sil."""

from edge_runtime.common.commands import edge_sil

if __name__ == "__main__":
    edge_sil()
