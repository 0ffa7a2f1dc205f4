"""The compiled kernel beside numpy, and what happens where it cannot be used."""

import dataclasses
import math
import platform
import re
import shutil
import subprocess
import sysconfig
import time
from types import SimpleNamespace

import numpy as np
import pytest
from bundles import MANIFEST
from guidance_cases import Stepwise, guide_for, random_team
from msgspec.structs import replace
from networks import ENGINES, needs_kernel, random_weights
from paths import ROOT

from edge_runtime.errors import PolicyError
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.projection import COMBINE
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.objectives import BUILT_IN, ObstacleMargin, SafetyMargin, SpeedLimit
from edge_runtime.policy import backend
from edge_runtime.policy import compiled_policy as kernel
from edge_runtime.policy.backend import make_policy
from edge_runtime.policy.compiled_policy import CompiledPolicy, load_kernel
from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.policy.velocity_field import PYTHON


@pytest.fixture(autouse=True)
def warn_again():
    backend._warn.cache_clear()


# Projecting onto v multiplies rounding by |guidance| / |v|, without bound where the flow comes to rest.
@pytest.mark.parametrize(
    ("mode", "tolerance"), [("none", 1e-6), ("cone", 1e-6), ("hierarchical", 1e-4), ("terminal", 1e-4)]
)
def test_an_action_equals_numpys(make_compiled, mode, tolerance):
    weights = random_weights(hidden=(256, 256, 256), observation_dim=32)
    guide = guide_for([SpeedLimit(limit_m_s=0.2), SafetyMargin(distance_m=0.5)], mode=mode, scale=1.0)
    numpy, compiled = FlowPolicy(weights, 10), make_compiled(weights, 10)
    for seed in range(5):
        draw = np.random.default_rng(seed)
        observation, team = draw.standard_normal((1, 32)).astype(np.float32), random_team(draw)
        expected = guided_action(numpy, observation, team, guide)
        found = guided_action(compiled, observation, team, guide)
        np.testing.assert_allclose(found.action, expected.action, rtol=tolerance, atol=tolerance)


def test_the_kernel_sees_the_obstacles_that_python_sees(make_compiled):
    policy, sensor = make_compiled(random_weights(), 5), MANIFEST.body.sensor()
    guide = replace(guide_for([ObstacleMargin(distance_m=0.3), SpeedLimit(limit_m_s=0.2)]), sensor=sensor)
    steered = 0
    for seed in range(20):
        draw = np.random.default_rng(seed)
        observation = draw.standard_normal((1, 18)).astype(np.float32)
        team = replace(random_team(draw), ranges_m=tuple(draw.uniform(0.0, 0.5, len(sensor.rays)).tolist()))
        compiled = guided_action(policy, observation, team, guide)
        python = guided_action(Stepwise(policy), observation, team, guide)
        np.testing.assert_allclose(compiled.action, python.action, rtol=1e-4, atol=1e-5)
        blind = guided_action(policy, observation, team, replace(guide, sensor=None))
        steered += blind.action != compiled.action
    assert steered > 10


@needs_kernel
def test_the_kernel_says_what_it_knows():
    module = load_kernel()
    assert set(module.PROJECTIONS) == set(COMBINE)
    assert {*module.TERMS} == {PYTHON} | {kind.__struct_config__.tag for kind in BUILT_IN}
    assert (module.MAX_TERMS, module.MAX_LAYERS) == (32, 16)


def test_more_terms_than_the_kernel_holds_are_left_to_python(make_compiled):
    policy, most = make_compiled(random_weights(), 2), load_kernel().MAX_TERMS
    knows, limit = policy.sampler.knows, SpeedLimit(limit_m_s=1.0)
    steering = guide_for([limit] * most).steering
    assert knows(steering)
    assert not knows(steering._replace(projection="sideways"))
    assert not knows(steering._replace(terms=(steering.terms[0]._replace(kind="a_wish"),)))
    guide = guide_for([limit] * (most + 1))
    assert not knows(guide.steering)
    found = guided_action(policy, np.zeros((1, 18), np.float32), random_team(np.random.default_rng(0)), guide)
    assert (found.fault, len(found.costs)) == ("", most + 1)


def test_coinciding_robots_part_in_the_order_of_their_numbers(make_compiled):
    weights = random_weights()
    guide = guide_for([SafetyMargin(distance_m=0.3)], mode="none", scale=1.0)
    policy, observation = make_compiled(weights, 1), np.zeros((1, 18), np.float32)
    policy.observe(observation)
    (velocity,), _, _ = policy.step(0, ((0.0, 0.0),)).copy()
    preview = guide.previews[0]
    # One step from rest at the terminal estimate: place the neighbour exactly there.
    there = tuple((preview.position_gain * velocity.astype(float)).tolist())
    for own, mate in [(0, 1), (1, 0)]:
        team = TeamState(
            RobotState(own, 0.0, (0.0, 0.0), (0.0, 0.0)),
            (Teammate(RobotState(mate, 0.0, there, (0.0, 0.0))),),
        )
        compiled = guided_action(policy, observation, team, guide)
        python = guided_action(Stepwise(policy), observation, team, guide)
        assert math.isfinite(compiled.action[0])
        assert compiled.costs[0] > 0.0
        np.testing.assert_allclose(compiled.action, python.action, rtol=1e-6)


def test_a_late_tick_returns_the_newest_estimate(make_compiled):
    policy = make_compiled(random_weights(), 10)
    guide = guide_for([SpeedLimit(limit_m_s=0.2)])
    team, observation = random_team(np.random.default_rng(0)), np.zeros((1, 18), np.float32)
    late = guided_action(policy, observation, team, guide, deadline_s=0.0)
    python = guided_action(Stepwise(policy), observation, team, guide, deadline_s=0.0)
    assert late.steps == python.steps == 1
    np.testing.assert_allclose(late.action, python.action, rtol=1e-6)
    in_time = guided_action(policy, observation, team, guide, deadline_s=time.monotonic() + 60.0)
    assert in_time.steps == 10


@pytest.mark.parametrize("steps", [1, 3, 9, 10])
def test_a_sample_can_be_cut_after_any_step(make_backend, steps):
    """A tick that its deadline cut short is repeated by the number of its steps."""
    policy, guide = (
        make_backend(random_weights(), 10),
        guide_for([], mode="none"),
    )
    observation, team = np.ones((1, 18), np.float32), random_team(np.random.default_rng(0))
    found = guided_action(policy, observation, team, guide, (0.3, -0.2), most_steps=steps)
    policy.observe(observation)
    action = np.array([0.3, -0.2])
    for k in range(steps):
        velocity = policy.step(k, action[None]).astype(float)[0, 0]
        action = action + velocity * (1.0 - k / 10 if k + 1 == steps else 0.1)
    assert (found.steps, found.cut) == (steps, steps < 10)
    np.testing.assert_allclose(found.action, action, rtol=1e-6, atol=1e-7)


def test_a_gradient_that_is_not_finite_is_named(make_compiled):
    guide = guide_for([SpeedLimit(limit_m_s=0.2), SafetyMargin(distance_m=0.3)])
    policy, observation = make_compiled(random_weights(), 10), np.zeros((1, 18), np.float32)
    team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (math.inf, 0.0)))
    found = guided_action(policy, observation, team, guide)
    assert found == guided_action(Stepwise(policy), observation, team, guide)
    assert "speed_limit is not finite" in found.fault


@pytest.mark.parametrize("stepwise", [False, True])
def test_a_velocity_that_is_not_finite_is_no_objectives_fault(make_compiled, stepwise):
    weights = random_weights()
    weights.biases[-1][0] = np.nan
    policy = make_compiled(weights, 5)
    guide, team = guide_for([SpeedLimit(limit_m_s=0.2)]), random_team(np.random.default_rng(1))
    found = guided_action(
        Stepwise(policy) if stepwise else policy, np.zeros((1, 18), np.float32), team, guide
    )
    assert (found.action, found.fault) == ((0.0, 0.0), "the policy's velocity is not finite")


def program(count, dims=2.0, rounds=-1.0, steps=5.0):
    """The head that so many terms follow."""
    return [0.0, 1.0, float(count), dims, rounds, 0.5, steps]


NO_TERMS, PYTHON_TERM = program(0), [9.0, 1.0, 1.0, 0.0, 0.1, 0.0, 0.0]


def sample(net, program=NO_TERMS, sight=(0, 0, 0), view=(0.0,) * 6, start=(0.0, 0.0)):
    return net.sample(np.asarray(program), sight, np.asarray(view), start, 1.0, 9, None)


def batch(net, program=NO_TERMS, actions=None):
    actions = np.zeros((1, 2)) if actions is None else actions
    return net.sample_batch(np.asarray(program), (0, 0, 0), np.zeros(6), actions)


@pytest.mark.parametrize(
    ("call", "problem"),
    [
        (lambda net: net.step(3), IndexError),
        (lambda net: net.step(-1), IndexError),
        (lambda net: net.step(2**70), OverflowError),
        (lambda net: net.step("0"), TypeError),
        (lambda net: net.observe(np.zeros((1, 18))), ValueError),
        (lambda net: net.observe(np.zeros((1, 36), "f")[:, ::2]), ValueError),
        (lambda net: net.observe(np.zeros((1, 17), "f")), ValueError),
        (lambda net: sample(net, program=[9.0, *NO_TERMS[1:]]), ValueError),
        (lambda net: sample(net, program=NO_TERMS[:6]), ValueError),
        (lambda net: sample(net, program=np.array(NO_TERMS, "f")), ValueError),
        (lambda net: sample(net, sight=(1, 0, 0)), ValueError),
        (lambda net: sample(net, sight=(-1, 0, 0)), ValueError),
        (lambda net: sample(net, sight=(0, 0)), TypeError),
        (lambda net: sample(net, view=[0.0] * 5), ValueError),
        (lambda net: sample(net, view=np.zeros(6, "f")), ValueError),
        *(
            (lambda net, start=start: sample(net, start=start), error)
            for start, error in (
                ((0.0,), ValueError),
                ((0.0,) * 3, ValueError),
                ([0.0] * 2, ValueError),
                (("0", 0.0), TypeError),
            )
        ),
        (lambda net: batch(net, actions=np.zeros((1, 2), "f")), ValueError),
        (lambda net: batch(net, actions=np.zeros((2, 2))), ValueError),
        (lambda net: batch(net, actions=np.frombuffer(bytes(16)).reshape(1, 2)), ValueError),
        (lambda net: batch(net, program=[*program(1), *PYTHON_TERM]), ValueError),
    ],
)
def test_the_extension_reads_nothing_beyond_its_arguments(make_compiled, call, problem):
    with pytest.raises((problem, BufferError)):
        call(make_compiled(random_weights(), 3)._network)


def term(kind, *numbers, dims=2, model=None, count=None, preference=0.0):
    """A term of two action components, which may not hold what it says."""
    size = 2 + 6 * dims
    head = [kind, 1.0, 1.0, preference, 0.1, size if model is None else model]
    return [*head, len(numbers) if count is None else count, *[1.0] * size, *numbers]


HOSTILE = (-1.0, 0.5, 1e300, math.inf, math.nan)


@pytest.mark.parametrize(
    "wrong",
    [
        [],
        term("speed_limit", 0.2, 0.1)[:4],
        term("speed_limit", 0.2, 0.1)[:-1],
        term("speed_limit", 0.2),
        term("speed_limit", 0.2, 0.1, 0.3),
        term("safety_margin"),
        term("safety_margin", 0.2, 0.3),
        term("attraction", 0.2),
        term("attraction", 0.2, 0.0, 0.3),
        term("geofence", 0.2, 0.3),
        term("geofence", 0.2, 0.3, 0.4, 0.5),
        term("spatial_order", 0.2),
        term("passing", 0.2, 0.3, 0.4),
        term("python"),
        *(term(kind, 0.2, 0.1) for kind in (*HOSTILE, "of no kind")),
        *(term("speed_limit", 0.2, 0.1, model=model) for model in (*HOSTILE, 0.0, 13.0, 15.0)),
        *(term("spatial_order", 0.2, 0.1, count=count) for count in (*HOSTILE, 1.0, 3.0, 2147483648.0)),
        *(term("speed_limit", 0.2, 0.1, preference=preference) for preference in (*HOSTILE, 2.0)),
    ],
)
def test_the_kernel_refuses_terms_that_do_not_hold_what_they_say(make_compiled, wrong):
    policy, right = make_compiled(random_weights(), 3), term("speed_limit", 0.2, 0.1)
    net, kinds = policy._network, policy._kinds
    right, wrong = (
        [kinds.get(each, len(kinds)) if isinstance(each, str) else each for each in stated]
        for stated in (right, wrong)
    )
    sample(net, [*program(1), *right])
    for place, terms in ((0, [wrong]), (1, [right, wrong])):
        flat = [number for each in terms for number in each]
        with pytest.raises(ValueError, match=f"objective {place} does not hold what its kind takes"):
            sample(net, [*program(place + 1), *flat])


@pytest.mark.parametrize(
    "head",
    [
        *(program(count) for count in (*HOSTILE, 33.0)),
        *(program(0, dims) for dims in (*HOSTILE, 1.0, 4.0)),
        *(program(0, steps=steps) for steps in (*HOSTILE, 0.0, 1001.0)),
    ],
)
def test_the_kernel_refuses_a_head_that_says_nothing(make_compiled, head):
    with pytest.raises(ValueError, match="no head"):
        sample(make_compiled(random_weights(), 3)._network, head)


@pytest.mark.parametrize(
    ("part", "replacement"),
    [
        (5, np.zeros((1, 3), "f")),
        (5, np.zeros((1, 2))),
        (6, np.zeros((1, 3, 3), "f")),
        (6, np.frombuffer(bytes(24), "f").reshape(1, 3, 2)),
        (3, (32, 24, 24)),
        (3, (32, 25)),
        (3, ("32", 24)),
        (4, ()),
    ],
)
def test_the_extension_takes_no_array_of_another_size(make_compiled, monkeypatch, part, replacement):
    module = kernel.load_kernel()

    def network(*arguments):
        return module.Network(*arguments[:part], replacement, *arguments[part + 1 :])

    changed = SimpleNamespace(**{**vars(module), "Network": network})
    monkeypatch.setattr(kernel, "load_kernel", lambda: changed)
    with pytest.raises((PolicyError, TypeError, BufferError)):
        make_compiled(random_weights(), 3)


def test_a_network_too_deep_for_the_kernel_is_refused_and_numpy_takes_over(make_compiled, capsys):
    weights = random_weights(hidden=(4,) * 17)
    with pytest.raises(PolicyError, match="1 to 16 hidden layers, got 17"):
        make_compiled(weights, 2)
    assert make_policy(weights, 2).backend == "numpy"
    assert "17; continuing with the numpy backend" in capsys.readouterr().err


@needs_kernel
def test_an_engine_that_the_processor_lacks_is_refused():
    with pytest.raises(PolicyError, match="no engine sse9"):
        CompiledPolicy(random_weights(), 2, engine="sse9")


@needs_kernel
def test_a_kernel_that_disagrees_is_refused_with_one_warning(monkeypatch, capsys):
    honest = CompiledPolicy.step
    monkeypatch.setattr(CompiledPolicy, "step", lambda self, k, action: honest(self, k, action) * 1.001)
    assert [make_policy(random_weights(), 2).backend for _ in range(3)] == ["numpy"] * 3
    warning = capsys.readouterr().err
    assert warning.count("\n") == 1
    assert "differs from numpy" in warning
    with pytest.raises(PolicyError, match="differs from numpy"):
        make_policy(random_weights(), 2, backend="compiled")


@needs_kernel
def test_a_kernel_that_returns_nan_is_refused(monkeypatch):
    monkeypatch.setattr(CompiledPolicy, "step", lambda self, _k, _a: np.full((3, self.batch, 2), np.nan))
    with pytest.raises(PolicyError, match="differs from numpy"):
        make_policy(random_weights(), 2, backend="compiled")


def test_a_kernel_that_was_not_built_is_refused_with_one_warning(monkeypatch, capsys):
    def missing(name):
        raise ImportError(f"No module named '{name}'")

    monkeypatch.setattr(kernel.importlib, "import_module", missing)
    assert [make_policy(random_weights(), 2).backend for _ in range(2)] == ["numpy"] * 2
    warning = capsys.readouterr().err
    assert warning.count("\n") == 1
    assert "install a C compiler" in warning
    with pytest.raises(PolicyError, match="install a C compiler"):
        make_policy(random_weights(), 2, backend="compiled")


def test_an_unknown_backend_is_refused_with_the_known_ones():
    with pytest.raises(PolicyError, match="'cuda' is not one of auto, numpy, compiled"):
        make_policy(random_weights(), 2, backend="cuda")


@needs_kernel
def test_auto_takes_the_kernel_where_it_works():
    assert make_policy(random_weights(), 2).backend == "compiled"
    assert make_policy(random_weights(), 2, backend="numpy").backend == "numpy"


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_kernel_is_built_where_a_compiler_is():
    assert ENGINES


@pytest.mark.parametrize("asked", ["auto", "numpy"])
def test_a_network_whose_numbers_overflow_is_refused(weights, asked):
    large = dataclasses.replace(weights, matrices=tuple(1e30 * matrix for matrix in weights.matrices))
    with pytest.raises(PolicyError, match="computes numbers that are not finite"):
        backend.make_policy(large, 10, backend=asked)


def test_a_kernel_of_another_version_is_refused(monkeypatch):
    monkeypatch.setattr(kernel.importlib, "import_module", lambda _name: SimpleNamespace(TERMS=()))
    with pytest.raises(PolicyError, match="of another version; reinstall"):
        make_policy(random_weights(), 2, backend="compiled")


@pytest.mark.skipif(
    platform.machine() != "x86_64" or shutil.which("aarch64-linux-gnu-gcc") is None,
    reason="needs a machine that compiles for aarch64",
)
def test_sums_stay_in_the_registers_of_neon(tmp_path):
    """A sum that goes to the stack and back costs the product a fifth of its speed."""
    flags = ["-O3", "-ffp-contract=fast", "-Wno-psabi", "-I", sysconfig.get_paths()["include"], "-S"]
    source, made = ROOT / "edge_runtime" / "policy" / "_kernel.c", tmp_path / "kernel.s"
    subprocess.run(["aarch64-linux-gnu-gcc", *flags, "-o", made, source], check=True, capture_output=True)
    product = made.read_text().partition("\nproduct_baseline:")[2].partition(".size\tproduct_baseline")[0]
    assert product.count("fmla") > 50
    assert not re.findall(r"\b(?:str|stp|ldr|ldp)\s+q.*\[sp", product)
