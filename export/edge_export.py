"""``edge-export``: a training run, or a graph that somebody else trained, becomes a policy bundle."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from edge_runtime.common.command_line import CommandParser, command
from edge_runtime.common.flag_types import whole_number
from edge_runtime.errors import ConfigError
from edge_runtime.observation import ObservationField
from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.manifest import Training
from edge_runtime.policy.schema import MAX_STEPS
from edge_runtime.policy.signature import LARGEST_VERSION
from export.algorithms.derivatives import evaluate_torch
from export.bundle.facts import Facts, read_facts
from export.bundle.facts_template import facts_template
from export.bundle.parity import SAMPLES, random_inputs
from export.bundle.signer import Signer
from export.bundle.upgrade import replace_manifest, upgrade_bundle
from export.bundle.writer import bundle_draft, write_bundle, write_manifest
from export.onnx.graph import velocity_graph
from export.onnx.importing import import_graph
from export.onnx.jacobian import with_jacobian
from export.scenarios import SCENARIOS, scenario_facts
from export.training.checkpoint import PolicyFacts, load_policy
from export.training.seen import read_calibration, roll_out, with_seen

EPILOG = """\
exit codes:
  0  the bundle is written
  2  a flag, file or run does not hold together; one line says what
  130  interrupted

examples:
  edge-export runs/nav --out policies/navigation
  edge-export --print-facts-template > facts.toml
  edge-export --from-onnx velocity.onnx --facts facts.toml --out policies/mine
  edge-export --from-onnx velocity.onnx --facts facts.toml --calibration seen.npz --out policies/mine
  edge-export --upgrade policies/old
  edge-export --seen policies/mine
  edge-export --resample policies/mine --exponential-steps 3
  edge-export runs/nav --out policies/navigation --sign release.key
  edge-export --out policies/navigation --sign release.key      a bundle that is there already

A key for --sign is a secret: (umask 077 && openssl rand -hex 32 > release.key). Robots whose fleet file names
its public key, which is printed, in trusted_keys of [team] run nothing that is not signed by it.

A graph for --from-onnx has the float inputs action (batch, d), tau (batch, 1), observation (batch, O) and
computes the flow's velocity (batch, d). Where it is a plain SiLU or tanh MLP the robot needs only numpy,
otherwise onnxruntime.
"""


def export_run(run_dir: Path, target: Path, *, force: bool = False) -> float:
    """Export the best policy of a training run.

    Returns:
        The largest difference between the forms of the policy.

    Raises:
        ConfigError: if the run holds no policy, or one of other shapes than its scenario's, or ``target``
            exists.
        BundleError: if the forms differ.
    """
    network, origin = load_policy(run_dir)
    facts, weights = _scenario_facts(origin), network.to_weights()
    graph = with_jacobian(velocity_graph(weights))
    inputs = random_inputs(facts)
    expected = evaluate_torch(network, inputs)
    with bundle_draft(target, force=force) as draft:
        difference = write_bundle(draft, facts, graph, weights, inputs, expected)
        bundle = load_bundle(draft)
        write_manifest(draft, with_seen(bundle.manifest, roll_out(bundle)))
        load_bundle(draft)
    return difference


def tell_seen(directory: Path, calibration: Path | None) -> str:
    """Write into a bundle what its policy saw in training, and return a line that says so.

    Args:
        directory: the bundle's.
        calibration: a file of observations; the policy is rolled out in its training's task where None.

    Raises:
        BundleError: if it is no bundle that loads.
        ConfigError: if the policy was not trained here and there is no file, or the file does not fit.
    """
    bundle = load_bundle(directory)
    size = bundle.manifest.observation_dim
    extremes = roll_out(bundle) if calibration is None else read_calibration(calibration, size)
    again = replace_manifest(bundle, with_seen(bundle.manifest, extremes))
    return f"{directory}: what the policy saw is written into its manifest{again}"


def resample(directory: Path, steps: int) -> str:
    """Have a bundle's flow integrated in ``steps`` of the exponential sampler; returns a line that says so.

    Raises:
        BundleError: if it is no bundle that loads.
        ConfigError: if it cannot be written.
    """
    bundle = load_bundle(directory)
    again = replace_manifest(bundle, bundle.sampled("exponential", steps).manifest)
    return f"{directory}: its flow is integrated exponentially, in {steps} steps{again}"


@command("edge-export")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-export``; returns the exit code."""
    print(_run(make_parser().parse_args(arguments)))
    return 0


def _run(arguments: argparse.Namespace) -> str:
    if arguments.print_facts_template:
        return facts_template()
    _check_change(arguments)
    if arguments.upgrade is not None:
        return upgrade_bundle(arguments.upgrade, _scenario_fields)
    if arguments.calibration is not None and arguments.from_onnx is None and arguments.seen is None:
        raise ConfigError("--calibration goes with --from-onnx or --seen: a run's policy is rolled out")
    if arguments.seen is not None:
        return tell_seen(arguments.seen, arguments.calibration)
    if (arguments.resample is None) != (arguments.exponential_steps is None):
        raise ConfigError("--resample DIR and --exponential-steps N go together")
    if arguments.resample is not None:
        return resample(arguments.resample, arguments.exponential_steps)
    if arguments.out is None:
        raise ConfigError("--out DIR is missing: the directory of the bundle to write")
    if arguments.bundle_version is not None and arguments.sign is None:
        raise ConfigError("--bundle-version goes with --sign: it is part of what is signed")
    signer = Signer(arguments.sign, arguments.out, arguments.bundle_version) if arguments.sign else None
    if signer and arguments.run is None and arguments.from_onnx is None:
        return signer.sign()
    told = _export(arguments)
    return f"{told}\n{signer.sign()}" if signer else told


def _check_change(arguments: argparse.Namespace) -> None:
    """Refuse what would be left undone: a bundle that is there is changed in one way at a time."""
    changes = [name for name in ("upgrade", "seen", "resample") if getattr(arguments, name) is not None]
    others = (arguments.run, arguments.from_onnx, arguments.out, arguments.sign)
    if changes and (len(changes) > 1 or any(others)):
        raise ConfigError(
            f"--{changes[0]} DIR changes a bundle that is there: it goes without RUN, --from-onnx, --out, "
            "--sign and other changes"
        )


def _export(arguments: argparse.Namespace) -> str:
    if (arguments.run is None) == (arguments.from_onnx is None):
        raise ConfigError("name either a training run or --from-onnx FILE")
    if arguments.from_onnx is None and arguments.facts is not None:
        raise ConfigError("--facts goes with --from-onnx: a training run brings its own facts")
    if arguments.from_onnx is None:
        difference, how = export_run(arguments.run, arguments.out, force=arguments.force), "numpy"
    else:
        if arguments.facts is None:
            raise ConfigError("--from-onnx needs --facts FILE; --print-facts-template prints an example")
        facts = read_facts(arguments.facts)
        if arguments.calibration is not None:
            facts = with_seen(facts, read_calibration(arguments.calibration, facts.observation_dim))
        imported = import_graph(arguments.from_onnx, facts, arguments.out, force=arguments.force)
        difference, how = imported.difference, imported.how
    told = ""
    if arguments.from_onnx is not None and arguments.calibration is None:
        told = (
            "\nwhat it saw in training is not known: robots cannot tell what is new to it; see --calibration"
        )
    return (
        f"{arguments.out}: bundle written, the robot computes it with {how}\n"
        f"largest difference between the source, policy.onnx and the runtime: {difference:.1e} "
        f"over {SAMPLES} random inputs{told}"
    )


def _scenario_facts(origin: PolicyFacts) -> Facts:
    scenario = scenario_facts(origin.scenario, preferred=origin.preferred)
    rate_hz, steps = scenario.control_rate_hz, origin.euler_steps
    robot = (scenario.motion, scenario.body)
    return Facts(scenario.observation, scenario.action, rate_hz, steps, *robot, origin.training, origin.start)


def _scenario_fields(training: Training) -> tuple[ObservationField, ...]:
    """What a policy that was trained here observes; nothing if its scenario is not known."""
    if training.scenario not in SCENARIOS:
        return ()
    return scenario_facts(training.scenario, preferred=training.algorithm == "pc-mappo").observation


def make_parser() -> CommandParser:
    """The command line."""
    description = "Write the policy bundle that edge-run loads, after checking that all its forms agree."
    parser = CommandParser("edge-export", description, EPILOG)
    parser.add_argument("run", nargs="?", type=Path, metavar="RUN", help="directory of an edge-train run")
    parser.add_argument("--from-onnx", type=Path, metavar="FILE", help="export this velocity graph instead")
    parser.add_argument("--facts", type=Path, metavar="FILE", help="TOML facts for --from-onnx")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="the bundle's directory; its name is the policy's"
    )
    parser.add_argument(
        "--upgrade", type=Path, metavar="DIR", help="write this bundle's manifest anew, in today's format"
    )
    parser.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help=".npz with an array `observation` (n, O), what the policy saw; for --from-onnx and --seen",
    )
    parser.add_argument(
        "--seen",
        type=Path,
        metavar="DIR",
        help="write into this bundle what its policy saw, by rolling it out in its training's task",
    )
    parser.add_argument(
        "--resample",
        type=Path,
        metavar="DIR",
        help="have this bundle's flow integrated by the exponential sampler, in --exponential-steps",
    )
    parser.add_argument(
        "--exponential-steps", type=whole_number(1, MAX_STEPS), metavar="N", help="for --resample"
    )
    parser.add_argument("--force", action="store_true", help="replace an existing bundle")
    parser.add_argument("--sign", type=Path, metavar="KEY", help="sign the bundle with this private key")
    parser.add_argument(
        "--bundle-version",
        type=whole_number(1, LARGEST_VERSION),
        metavar="N",
        help="version to sign; robots run none that is older than what they ran "
        "(default: one above that of the bundle which --out names, else 1)",
    )
    parser.add_argument(
        "--print-facts-template", action="store_true", help="print a facts file to start from"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
