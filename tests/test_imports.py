"""The house: which package may import which, how few modules lie in its hall, what a robot does not need."""

import ast
import pkgutil
import subprocess
import sys
from collections import Counter

import pytest
from paths import ROOT

import edge_runtime
import firmware_bridge

FLOORS = """
edge_runtime
edge_runtime.common
edge_runtime.motion
edge_runtime.objectives edge_runtime.observation edge_runtime.tools.report.page
edge_runtime.policy
edge_runtime.guidance
edge_runtime.config
edge_runtime.control edge_runtime.network
edge_runtime.recording edge_runtime.team edge_runtime.telemetry firmware_bridge.sil.report
edge_runtime.tools.ctl edge_runtime.tools.pose edge_runtime.tools.replay edge_runtime.tools.watch
edge_runtime.tools.report
edge_runtime.run
edge_runtime.doctor edge_runtime.completion
firmware_bridge.guard firmware_bridge.kinematics
firmware_bridge.simulation
firmware_bridge.simulation.wheels
firmware_bridge.can firmware_bridge.mavlink firmware_bridge.ros
firmware_bridge.sil.measurement firmware_bridge.sil.scenario
firmware_bridge.sil.firmware firmware_bridge.sil.network
firmware_bridge.sil.harness
firmware_bridge.sil.judge
firmware_bridge.sil
export.beliefs export.bundle export.common export.evaluation
export.algorithms export.onnx export.scenarios
export.episodes
export.training export.values
export.schedule
export
benchmarks.common
benchmarks.sil
benchmarks.faults benchmarks.latency benchmarks.obstacles benchmarks.paper benchmarks.recording
benchmarks.paper.ablation benchmarks.paper.modes benchmarks.paper.oracle benchmarks.paper.samplers
benchmarks.husky benchmarks.paper.team_size benchmarks.paper.steering
benchmarks
"""
"""Every package, a floor a line, the lowest first: imports lead to lower floors, or stay in the package."""
TABLES = {
    "edge_runtime.common.commands",
    "edge_runtime.run.bridges",
    "export.schedule.job",
    "firmware_bridge.simulation.plants",
    "benchmarks.__main__",
}
"""Modules that name others in strings, each imported where it is chosen, whatever its floor."""
MOST_MODULES = {"edge_runtime": 8, "firmware_bridge": 4}
"""Directly in these packages."""
WORKSTATION = {"torch", "vmas", "onnx", "onnxruntime", "gym", "mujoco", "export"}
WHEELS = ("firmware_bridge.simulation.wheels", "firmware_bridge.sil.firmware.wheeled_world")
"""What a workstation's --plant mujoco imports."""


def name_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


TOPS = sorted({name.partition(".")[0] for name in FLOORS.split()})
FILES = {name_of(path): path for top in TOPS for path in (ROOT / top).rglob("*.py")}


def package_of(module):
    return module if FILES[module].name == "__init__.py" else module.rpartition(".")[0]


PACKAGES = {package_of(name) for name, path in FILES.items() if path.name != "__init__.py"}
FLOOR_OF = {name: number for number, line in enumerate(FLOORS.split("\n")) for name in line.split()}


def floor(module):
    """That of its package; a package that holds nothing but packages lies below all."""
    return FLOOR_OF.get(package_of(module), -1)


def imported(module):
    """Yield the modules of this repository that one imports, or names in a string to import them later."""
    for node in ast.walk(ast.parse(FILES[module].read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: imports are absolute"
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if name in FILES else node.module for name in inner]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and module not in TABLES:
            names = [node.value]
        else:
            continue
        yield from (name for name in names if name in FILES)


def test_every_package_has_its_floor():
    assert set(FLOOR_OF) == PACKAGES


def test_imports_lead_to_lower_floors():
    # The package's own module names what lies above for type checkers, and imports it when it is asked for.
    ways = {(module, other) for module in FILES if module != "edge_runtime" for other in imported(module)}
    assert len(ways) > 1000
    up = [
        f"{module} imports {other}"
        for module, other in sorted(ways)
        if package_of(module) != package_of(other) and floor(module) <= floor(other)
    ]
    assert not up


@pytest.mark.parametrize("package", MOST_MODULES)
def test_few_modules_lie_in_the_hall(package):
    direct = Counter(package_of(name) for name, path in FILES.items() if path.name != "__init__.py")
    assert direct[package] <= MOST_MODULES[package]


def modules_of(package):
    return [info.name for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")]


def loaded_after(names):
    """The modules of a fresh interpreter that has imported these."""
    code = f"import importlib, sys\nfor name in {names!r}: importlib.import_module(name)\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize("package", [edge_runtime, firmware_bridge], ids=lambda package: package.__name__)
def test_no_module_needs_the_workstation(package):
    names = [name for name in modules_of(package) if not name.startswith(WHEELS)]
    assert len(names) > 1
    assert not loaded_after(names) & WORKSTATION


def test_edge_run_loads_little():
    loaded = loaded_after(["edge_runtime.run.edge_run", "firmware_bridge.simulation.bridge"])
    assert not loaded & (WORKSTATION | {"asyncio", "multiprocessing", "can", "pymavlink", "ssl", "zenoh"})
