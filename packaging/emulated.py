"""Lets the frozen CPython of cx_Freeze's wheels, which calls this alone, run a script as any would."""

import os
import runpy
import sys


def init() -> None:
    """Look for modules where any Python does; a frozen one does not."""
    sys.path += os.environ["PYTHONPATH"].split(":")


def run() -> None:
    """Run the script that is named first."""
    del sys.argv[0]
    runpy.run_path(sys.argv[0], run_name="__main__")
