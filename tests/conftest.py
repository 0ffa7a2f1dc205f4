"""Fixtures that several modules' tests share."""

import importlib.util
import itertools
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from edge_runtime.errors import PolicyError
from edge_runtime.policy.compiled_policy import CompiledPolicy, load_kernel
from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.policy.weights import FlowWeights

# A million cases of each property: pytest -k junk --hypothesis-profile=fuzz
settings.register_profile("fuzz", max_examples=1_000_000, deadline=None)


if importlib.util.find_spec("torch") is None:
    # A robot's environment: leave out what tests the workstation's side.
    modules = r"export|torch|vmas|onnx|matplotlib|benchmarks\.paper"
    workstation = re.compile(rf"^(from|import) ({modules})\b", re.MULTILINE)
    here = Path(__file__).parent
    collect_ignore = [path.name for path in here.glob("test_*.py") if workstation.search(path.read_text())]


@pytest.fixture(autouse=True, scope="session")
def _logs_of_tests(tmp_path_factory):
    """Keep the logs of tests out of the user's own folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


def random_weights(
    seed=0, action_dim=2, observation_dim=18, hidden=(32, 24), activation="silu", prior_std=0.5, features=4
) -> FlowWeights:
    """A flow network whose layers keep signals of order one."""
    draw = np.random.default_rng(seed)

    def layer(rows, columns, fan_in):
        return (draw.standard_normal((rows, columns)) / np.sqrt(fan_in)).astype(np.float32)

    fan_in = action_dim + observation_dim + 1 + features
    widths = (*hidden, action_dim)
    return FlowWeights(
        activation=activation,
        action=layer(action_dim, hidden[0], fan_in),
        observation=layer(observation_dim, hidden[0], fan_in),
        time=layer(1 + features, hidden[0], fan_in),
        time_frequency=(2 * np.pi * draw.uniform(0.5, 3, features)).astype(np.float32),
        time_phase=draw.uniform(0, np.pi, features).astype(np.float32),
        matrices=tuple(layer(a, b, a) for a, b in itertools.pairwise(widths)),
        biases=tuple((0.1 * draw.standard_normal(width)).astype(np.float32) for width in widths),
        prior_std=prior_std,
    )


@pytest.fixture
def weights() -> FlowWeights:
    return random_weights()


def _engines():
    try:
        return load_kernel().engines()
    except PolicyError:
        return []


ENGINES = _engines()
needs_kernel = pytest.mark.skipif(not ENGINES, reason="the compiled kernel was not built")


@pytest.fixture(scope="session", params=ENGINES or [pytest.param("", marks=needs_kernel)])
def make_compiled(request):
    """Makes a policy on each instruction set of the compiled kernel."""
    return partial(CompiledPolicy, engine=request.param)


@pytest.fixture(scope="session", params=["numpy", *ENGINES])
def make_backend(request):
    """Makes a policy on every backend of this machine."""
    return FlowPolicy if request.param == "numpy" else partial(CompiledPolicy, engine=request.param)
