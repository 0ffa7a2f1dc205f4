"""Fixtures that several modules' tests share."""

import importlib.util
import re
import signal
from functools import partial
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from networks import ENGINES, needs_kernel, random_weights

from edge_runtime.policy.compiled_policy import CompiledPolicy
from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.policy.weights import FlowWeights

# However long a case takes on a busy machine, it proves what it proves. The same cases each time: whoever
# changes something else is not stopped by one that nobody has met; --hypothesis-profile=search looks for it.
PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("search", PATIENT, derandomize=False)
# A million cases of each property: pytest -k junk --hypothesis-profile=fuzz
settings.register_profile("fuzz", PATIENT, derandomize=False, max_examples=1_000_000)
settings.register_profile("same", PATIENT, derandomize=True)
settings.load_profile("same")

# What shells start in the background is deaf to Ctrl-C, and so would be all that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    """Add what `make fuzz` and `python -m benchmarks peers` ask for."""
    parser.addoption("--fuzz", action="store_true", help="make all cases of tests/fuzz, not a few of each")
    parser.addoption("--commands", type=int, default=20, help="to every ROS peer, at 20 Hz")


if importlib.util.find_spec("torch") is None:
    # A robot's environment: leave out what tests the workstation's side.
    modules = r"export|torch|vmas|onnx|matplotlib|benchmarks\.(paper|husky)|foreign_policies|foreign_teams"
    workstation = re.compile(rf"^(from|import) ({modules})\b", re.MULTILINE)
    here = Path(__file__).parent
    collect_ignore = [
        str(path.relative_to(here))
        for path in here.rglob("test_*.py")
        if workstation.search(path.read_text())
    ]


@pytest.fixture(autouse=True, scope="session")
def _logs_of_tests(tmp_path_factory):
    """Keep the logs of tests out of the user's own folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture
def weights() -> FlowWeights:
    return random_weights()


@pytest.fixture(scope="session", params=ENGINES or [pytest.param("", marks=needs_kernel)])
def make_compiled(request):
    """Makes a policy on each instruction set of the compiled kernel."""
    return partial(CompiledPolicy, engine=request.param)


@pytest.fixture(scope="session", params=["numpy", *ENGINES])
def make_backend(request):
    """Makes a policy on every backend of this machine."""
    return FlowPolicy if request.param == "numpy" else partial(CompiledPolicy, engine=request.param)
