"""edge-replay: makes a log's decisions again and compares them, or asks what others would have been."""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from edge_runtime.common.command_line import CommandParser, check_output, command, complain, need
from edge_runtime.common.printable import printed
from edge_runtime.config.fleet import load_fleet
from edge_runtime.config.objectives import load_objective_set, own_objective
from edge_runtime.config.own_sources import add_own_source, load_own_sources
from edge_runtime.errors import BundleError, ConfigError, EdgeError
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.objectives import BUILT_IN, Objective
from edge_runtime.observation import Source
from edge_runtime.policy.bundle import PACKAGED, Bundle, load_bundle
from edge_runtime.policy.bundle_source import located
from edge_runtime.recording.reader import Damage, read_log
from edge_runtime.recording.schema import BundleIdentity, LoggedObjectiveSet, Record, Start, Tick
from edge_runtime.tools.replay.question import Answer, speeds_m_s
from edge_runtime.tools.replay.replay import Difference, Replay, recorded_objectives, recorded_policy
from edge_runtime.tools.replay.rosbag import write_bag

DESCRIPTION: Final = """\
Make every decision of a run again from its log, and compare it bit for bit: the observation of each state,
the action sampled for it, the command within its limits. A difference names the tick and the stage.
With --objectives or another --policy: what it would have done with these instead, situation by situation.
With --rosbag2: nothing is made again, the logs are converted."""
EPILOG: Final = """\
exit codes:
  0  every tick came out as it was; or the question was answered
  1  a tick came out otherwise; or a log breaks off or is damaged: what was read is judged, a line says where
  2  a flag, log or bundle does not hold together; one line says what, other logs are judged all the same
  130  interrupted

examples:
  edge-replay run_000.mcap
  edge-replay run_000.mcap --own stay_north:StayNorth     or --fleet team.toml
  edge-replay run_000.mcap --objectives slow.toml -o instead.png
  edge-replay run_000.mcap --policy policies/new -o instead.png
  edge-replay *_robot*.mcap --rosbag2 team                for ROS's own tools: nothing is replayed"""
SHOWN: Final = 10
"""So many differences are printed in full."""
PROGRESS_S: Final = 0.5
PICTURES: Final = (".png", ".pdf", ".svg")


def make_parser() -> CommandParser:
    """The command line."""
    parser = CommandParser("edge-replay", DESCRIPTION, EPILOG)
    add = parser.add_argument
    add("logs", nargs="+", type=Path, metavar="LOG", help="MCAP files of edge-run")
    add("--objectives", type=Path, metavar="FILE", help="what if these objectives and guidance had steered")
    add(
        "--policy",
        type=Path,
        metavar="DIR",
        help="bundle; if it is not the one that the log was made with: what if it had decided",
    )
    add(
        "--own",
        action="append",
        default=[],
        metavar="MODULE:CLASS",
        help="an objective of your own that the log may name, from this folder or installed; repeatable",
    )
    add_own_source(parser)
    add("--fleet", type=Path, metavar="FILE", help="fleet file, whose own code the log may name")
    add("-o", dest="picture", type=Path, metavar="FILE", help="draw what was and what would have been")
    add("--rosbag2", type=Path, metavar="DIR", help="convert: write the logs into a new bag of ROS 2")
    return parser


@dataclass
class ReplayResult:
    """What came of one log."""

    path: Path
    ticks: int = 0
    start: Start | None = None
    differing: int = 0
    """Ticks."""
    differences: list[Difference] = field(default_factory=list)
    """The first ones."""
    replay: Replay | None = None
    damage: str = ""
    refusal: str = ""
    """Why the log cannot be judged at all."""
    answer: Answer | None = None


@command("edge-replay")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-replay``; returns the exit code."""
    flags = make_parser().parse_args(arguments)
    if flags.rosbag2:
        return _convert(flags)
    instead = load_objective_set(flags.objectives) if flags.objectives else None
    asked = load_bundle(located(str(flags.policy))) if flags.policy else None
    if flags.picture:
        _check_picture(flags)
    own = _own(flags)
    results = [_attempt(path, asked, instead, own) for path in flags.logs]
    for result in results:
        if result.refusal:
            complain("edge-replay", result.refusal)
            continue
        print(_text(result, flags))
        if flags.picture:
            _draw(result, flags)
    if any(result.refusal for result in results):
        return 2
    return 1 if any(result.differing or result.damage for result in results) else 0


def _convert(flags: argparse.Namespace) -> int:
    if flags.objectives or flags.policy or flags.picture:
        raise ConfigError("--rosbag2 converts, it asks no question: leave out --objectives, --policy and -o")
    done = write_bag(flags.logs, flags.rosbag2)
    print(f"{flags.rosbag2}: {done.messages} messages of {done.ticks} ticks")
    for damage in done.damage:
        print(f"  damaged     {damage}; what comes later is not in it")
    return 1 if done.damage else 0


@dataclass(frozen=True)
class OwnCode:
    """What of the user's own may run: what the user names, and nobody else."""

    objectives: tuple[type[Objective], ...]
    sources: tuple[type[Source], ...]


def _own(flags: argparse.Namespace) -> OwnCode:
    objectives = [own_objective(name, Path.cwd(), f"--own {name}") for name in flags.own]
    fleet = load_fleet(flags.fleet) if flags.fleet else None
    if fleet is not None:
        kinds = map(type, fleet.objective_set.objectives)
        objectives += [kind for kind in kinds if kind not in BUILT_IN]
    return OwnCode(tuple(objectives), load_own_sources(fleet, flags.own_source))


def _attempt(path: Path, asked: Bundle | None, instead: ObjectiveSet | None, own: OwnCode) -> ReplayResult:
    """Replay one log; one that is refused hides no other's verdict."""
    try:
        return _replay(path, asked, instead, own)
    except EdgeError as error:
        return ReplayResult(path, refusal=str(error))


def _replay(path: Path, asked: Bundle | None, instead: ObjectiveSet | None, own: OwnCode) -> ReplayResult:
    result, replay = ReplayResult(path), None
    for record in _with_progress(read_log(path), path):
        if isinstance(record, Start):
            result.start = printed(record)
            bundle = asked or _recorded_bundle(record.bundle, path)
            replay = Replay(record, bundle, *recorded_policy(record, bundle), own.sources)
            result.replay = replay
            if instead is not None or not bundle.stands_for(record.bundle.sha256):
                result.answer = Answer(record)
            if instead is not None:
                replay.follow(instead)
        elif isinstance(record, LoggedObjectiveSet) and replay is not None and instead is None:
            if record.bundle and not asked and record.bundle.sha256 != replay.bundle.sha256:
                replay = result.replay = _handed_over(replay, _recorded_bundle(record.bundle, path), own)
            replay.follow(recorded_objectives(record, path, own.objectives))
        elif isinstance(record, Tick) and replay is not None:
            _judge(result, record, replay)
        elif isinstance(record, Damage):
            result.damage = record.message
    if not result.ticks:
        raise ConfigError(f"{path}: holds no tick{f': {result.damage}' if result.damage else ''}")
    return result


def _judge(result: ReplayResult, tick: Tick, replay: Replay) -> None:
    result.ticks += 1
    if result.answer is not None:
        result.answer.ask(tick, replay)
        return
    found = list(replay.differences(tick))
    result.differing += bool(found)
    result.differences += found[: SHOWN - len(result.differences)]


def _handed_over(before: Replay, bundle: Bundle, own: OwnCode) -> Replay:
    """Go on with the policy that the robot was handed under way."""
    policy, tolerance = recorded_policy(before.start, bundle)
    after = Replay(before.start, bundle, policy, max(tolerance, before.tolerance), own.sources)
    after.worst, after.unfamiliar = before.worst, before.unfamiliar
    return after


def _recorded_bundle(wanted: BundleIdentity, path: Path) -> Bundle:
    """Find a bundle that a log was made with, by its digest; its flow is integrated as it was then."""
    for directory in (PACKAGED / wanted.name, Path(wanted.directory)):
        try:
            bundle = load_bundle(directory)
        except BundleError:
            continue
        if bundle.stands_for(wanted.sha256):
            return bundle.sampled(wanted.sampler, wanted.euler_steps)
    raise ConfigError(
        f"{path}: was made with policy {wanted.name!r}, manifest SHA-256 {wanted.sha256[:12]}..., which is "
        f"neither packaged nor in {wanted.directory} now; give its directory with --policy, or another one's "
        "to ask what that would have done"
    )


def _check_picture(flags: argparse.Namespace) -> None:
    if not (flags.objectives or flags.policy):
        raise ConfigError("-o draws what would have been: say with --objectives or --policy what if")
    if len(flags.logs) > 1:
        raise ConfigError(f"-o {flags.picture}: one picture shows one log, got {len(flags.logs)}")
    if flags.picture.suffix.lower() not in PICTURES:
        raise ConfigError(f"-o {flags.picture}: a picture's name ends in {', '.join(PICTURES)}")
    need("matplotlib", "train")
    check_output("-o", flags.picture, (*flags.logs, flags.objectives, flags.fleet))


def _draw(result: ReplayResult, flags: argparse.Namespace) -> None:
    from edge_runtime.tools.replay.picture import draw  # noqa: PLC0415  # matplotlib is a workstation's

    if result.answer is None:
        raise ConfigError(
            f"-o {flags.picture}: {flags.policy} is the policy that the log was made with: nothing to compare"
        )
    try:
        draw(result.answer, _question(flags), flags.picture)
    except OSError as error:
        raise ConfigError(f"-o {flags.picture}: cannot be written ({error.strerror})") from error


def _question(flags: argparse.Namespace) -> str:
    return " and ".join(str(path) for path in (flags.objectives, flags.policy) if path)


def _text(result: ReplayResult, flags: argparse.Namespace) -> str:
    start = result.start
    lines = []
    if start is not None:
        engine = f", {start.settings.engine}" if start.settings.engine else ""
        lines += [
            f"{result.path}: robot {start.robot_id}, policy {start.bundle.name} "
            f"({start.settings.backend}{engine}), {result.ticks} ticks"
        ]
    if result.answer is not None:
        lines += _answer_lines(result.answer, _question(flags))
    elif not result.differing and start is not None and result.replay is not None and result.replay.tolerance:
        within = f"within {result.replay.tolerance:g} ({result.replay.worst:.1g} apart at most)"
        lines += [f"  alike       {result.ticks} ticks {within}: {start.machine.processor} rounds otherwise"]
    elif not result.differing:
        lines += [f"  identical   {result.ticks} ticks, bit for bit: observation, action, command"]
    else:
        lines += [f"  differs     {result.differing} of {result.ticks} ticks"]
        lines += [f"              {difference}" for difference in result.differences]
        if start is not None:
            lines += [f"  made on     {start.machine.processor}, numpy {start.versions.numpy}"]
    if result.replay is not None and result.replay.unfamiliar:
        outside = result.replay.unfamiliar
        fields = ", ".join(f"{field} {ticks}" for field, ticks in outside.most_common())
        lines += [f"  unfamiliar  {outside.total()} of {result.ticks} observations: {fields}"]
    if result.damage:
        lines += [f"  damaged     {result.damage}; what comes later is not judged"]
    return "\n".join(lines)


def _answer_lines(answer: Answer, question: str) -> list[str]:
    changes = answer.changes()
    done, instead = speeds_m_s(answer.done).max(), speeds_m_s(answer.instead).max()
    stops = sum(bool(command.stop_reason) for command in answer.instead)
    return [
        f"  what if     {question}",
        f"  actions     {int((changes > 0.0).sum())} of {len(changes)} would differ, "
        f"by {changes.mean():.3f} on average, {changes.max():.3f} at most",
        f"  speed       {done:.3f} m/s commanded at most, {instead:.3f} m/s instead",
        f"  stops       {sum(bool(command.stop_reason) for command in answer.done)} ticks, {stops} instead",
    ]


def _with_progress(records: Iterator[Record | Damage], path: Path) -> Iterator[Record | Damage]:
    """Pass records on; on a terminal, count the ticks."""
    shown, ticks, due_s = sys.stderr.isatty(), 0, time.monotonic() + PROGRESS_S
    for record in records:
        yield record
        ticks += isinstance(record, Tick)
        if shown and time.monotonic() >= due_s:
            due_s += PROGRESS_S
            print(f"\r{path.name}: {ticks} ticks\x1b[K", end="", file=sys.stderr, flush=True)
    if shown:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
