"""``python -m edge_runtime.tools.report`` is edge-report."""

from edge_runtime.common.commands import edge_report

if __name__ == "__main__":
    edge_report()
