"""``python -m edge_runtime.doctor`` is edge-doctor."""

from edge_runtime.common.commands import edge_doctor

if __name__ == "__main__":
    edge_doctor()
