"""The robot side stands without what only a workstation has."""

import pkgutil
import subprocess
import sys

import pytest

import edge_runtime
import firmware_bridge

WORKSTATION = {"torch", "vmas", "onnx", "onnxruntime", "gym", "export"}


def modules_of(package):
    return [info.name for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")]


def loaded_after(names):
    """The modules of a fresh interpreter that has imported these."""
    code = f"import importlib, sys\nfor name in {names!r}: importlib.import_module(name)\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize("package", [edge_runtime, firmware_bridge], ids=lambda package: package.__name__)
def test_no_module_needs_the_workstation(package):
    names = modules_of(package)
    assert len(names) > 1
    assert not loaded_after(names) & WORKSTATION


def test_edge_run_loads_little():
    loaded = loaded_after(["edge_runtime.run", "firmware_bridge.simulation.bridge"])
    assert not loaded & (WORKSTATION | {"asyncio", "multiprocessing", "can", "pymavlink", "ssl", "zenoh"})
