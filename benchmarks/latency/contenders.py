"""Everything that a user could pick to compute the tick, made ready for one workload.

A contender is a function without arguments that computes one tick and returns the actions (B, d). All
compute the same: `disagreement` holds them to it before anything is timed.
"""

import dataclasses
import tempfile
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.latency.cases import Workload
from edge_runtime.errors import PolicyError
from edge_runtime.guidance.flow import guided_action
from edge_runtime.objectives import Objective, SafetyMargin, SpeedLimit
from edge_runtime.policy.compiled_policy import CompiledPolicy
from edge_runtime.policy.numpy_policy import FlowPolicy
from edge_runtime.policy.velocity_field import VelocityField
from export.evaluation.guidance import guided_actions

Tick = Callable[[], np.ndarray]


def _runtime(policy: VelocityField, work: Workload) -> Tick:
    """The robot's own path for one robot, the evaluation's for several."""
    guide = work.make_guide()
    if work.case.batch > 1:
        return lambda: guided_actions(policy, work.observation, work.team, guide, work.start)
    team, start = work.team_state(), tuple(work.start[0].tolist())
    return lambda: np.array([guided_action(policy, work.observation, team, guide, start).action])


def numpy_runtime(work: Workload) -> Tick:
    """The numpy backend."""
    case = work.case
    return _runtime(FlowPolicy(work.weights, case.steps, case.batch, case.sampler), work)


def compiled(work: Workload) -> Tick:
    """The compiled kernel with the whole loop in it, for one robot or for several."""
    case = work.case
    return _runtime(CompiledPolicy(work.weights, case.steps, case.batch, case.sampler), work)


class _OwnLimit(SpeedLimit, frozen=True, kw_only=True, tag="own_limit"):
    """As one's own, the kernel asks Python for it."""


class _OwnMargin(SafetyMargin, frozen=True, kw_only=True, tag="own_margin"):
    """As one's own, the kernel asks Python for it."""


def compiled_own(work: Workload) -> Tick:
    """The compiled kernel with every objective in Python, as those of one's own are."""
    own: list[Objective] = [
        (_OwnLimit if isinstance(each, SpeedLimit) else _OwnMargin)(**msgspec.structs.asdict(each))
        for each in work.objectives
    ]
    return compiled(dataclasses.replace(work, objectives=tuple(own)))


def onnx_step(work: Workload) -> Tick:
    """The exported graph in onnxruntime, one call a step, objectives in Python."""
    from edge_runtime.policy.onnx_policy import OnnxPolicy  # noqa: PLC0415
    from export.onnx.graph import velocity_graph  # noqa: PLC0415
    from export.onnx.jacobian import with_jacobian  # noqa: PLC0415

    case = work.case
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.onnx"
        path.write_bytes(with_jacobian(velocity_graph(work.weights)).SerializeToString())
        policy = OnnxPolicy(path, case.action_dim, case.observation_dim, case.steps, case.batch)
    return _runtime(policy, work)


def onnx_loop(work: Workload) -> Tick:
    """The whole tick unrolled into one graph in onnxruntime."""
    import onnxruntime  # noqa: PLC0415
    import torch  # noqa: PLC0415

    from benchmarks.latency.torch_tick import FusedTick  # noqa: PLC0415

    inputs = (torch.from_numpy(work.observation), torch.from_numpy(work.start).float())
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tracer warns of every size that it makes constant: as intended
        path = Path(folder) / "tick.onnx"
        names = {"input_names": ["observation", "start"], "output_names": ["action"]}
        torch.onnx.export(FusedTick(work), inputs, str(path), dynamo=False, **names)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    feed = {"observation": work.observation, "start": work.start.astype(np.float32)}
    return lambda: session.run(None, feed)[0]


def eager(work: Workload) -> Tick:
    """Eager PyTorch with one backward pass per objective and step: what a researcher writes."""
    import torch  # noqa: PLC0415

    from benchmarks.latency.torch_eager import VelocityNetwork, eager_tick, make_costs  # noqa: PLC0415

    torch.set_num_threads(1)
    network, costs, factors = VelocityNetwork(work.weights), make_costs(work), work.make_guide().factors
    observation, start = torch.from_numpy(work.observation), torch.from_numpy(work.start).float()
    return lambda: eager_tick(network, costs, factors, work.case.steps, observation, start).numpy()


def torch_compile(work: Workload) -> Tick:
    """torch.compile of the whole tick, the Jacobian carried forward instead of backward passes."""
    import torch  # noqa: PLC0415

    from benchmarks.latency.torch_tick import FusedTick  # noqa: PLC0415

    torch.set_num_threads(1)
    tick = torch.compile(FusedTick(work), fullgraph=True)
    observation, start = torch.from_numpy(work.observation), torch.from_numpy(work.start).float()

    def run() -> np.ndarray:
        with torch.inference_mode():
            return tick(observation, start).numpy()

    run()
    return run


CONTENDERS: dict[str, Callable[[Workload], Tick]] = {
    "eager": eager,
    "torch-compile": torch_compile,
    "onnx-step": onnx_step,
    "onnx-loop": onnx_loop,
    "numpy": numpy_runtime,
    "compiled-own": compiled_own,
    "compiled": compiled,
}


def prepare(work: Workload, names: Sequence[str]) -> dict[str, Tick]:
    """Make contenders ready and hold them to the same result.

    Raises:
        PolicyError: if two contenders do not compute the same actions.
    """
    ticks = {name: CONTENDERS[name](work) for name in names}
    results = {name: tick() for name, tick in ticks.items()}
    reference = results["numpy"] if "numpy" in results else next(iter(results.values()))
    for name, result in results.items():
        difference = float(np.abs(result - reference).max())
        if not difference <= 1e-3 * max(1.0, float(np.abs(reference).max())):
            raise PolicyError(f"{name} computes other actions than numpy, by {difference:.2g}: {work.case}")
    return ticks
