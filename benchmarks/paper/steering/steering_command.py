"""``python -m benchmarks steering``: what steering along the flow wins over correcting its action.

Interrupt it and start it again as you like; ``chrt -i 0`` in front of it leaves the machine to others.
"""

import dataclasses
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch
from rich.progress import Progress

from benchmarks.common.flags import COUNT, add_policies, make_parser
from benchmarks.common.result_file import read_result, write_result
from benchmarks.paper.evaluation import commit
from benchmarks.paper.methods import decider
from benchmarks.paper.policies import digest, find_policy
from benchmarks.paper.steering.judge import SceneJudge
from benchmarks.paper.steering.rows import Asked, SteeringRow
from benchmarks.paper.steering.scenes import SCENES
from benchmarks.paper.steering.steering_page import steering_page
from benchmarks.paper.steering.ways import ways
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import tuned_default
from edge_runtime.policy.bundle import load_bundle
from export.episodes.neighbourhood import Setting
from export.episodes.play import play

RESULTS = Path(__file__).parents[2] / "results" / "steering.json"
HELD_OUT = (1, 2)
"""Of the policies."""
EPISODES_SEED = 2
"""Of starts and noise."""
NOISES = (1.0, 0.0)
"""Of the flow's start: broad, and contracted to its mean."""


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    parser = make_parser("steering", __doc__)
    parser.add_argument("--scenes", nargs="*", choices=tuple(SCENES), default=tuple(SCENES), help="(all)")
    parser.add_argument("--episodes", type=COUNT, default=100, help="of each row (100)")
    parser.add_argument("--seeds", type=int, nargs="*", default=HELD_OUT, help="of the policies (1 2)")
    add_policies(parser)
    parser.add_argument("--json", type=Path, default=RESULTS, metavar="FILE", help="the rows")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    asked = list(questions(options.scenes, options.seeds, options.episodes))
    rows = read_result(options.json, list[SteeringRow], default=[])
    known = {(row.asked, row.policy) for row in rows}
    with Progress(disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("rows", total=len(asked))
        for question in asked:
            policy = _policy(options.policies, question.seed)
            if (question, digest(policy)) not in known:
                rows.append(answer(question, policy))
                write_result(options.json, rows)
            progress.advance(bar)
    answers = [row for row in rows if row.asked in set(asked)]
    text = steering_page(answers)
    (options.json.parent / "paper").mkdir(exist_ok=True)
    (options.json.parent / "paper" / "steering.md").write_text(text)
    print(text)
    return 0


def questions(scenes: Sequence[str], seeds: Sequence[int], episodes: int) -> Iterator[Asked]:
    """All rows, scene by scene; the contracted flow where it chooses between ways only."""
    for scene in scenes:
        for noise in NOISES if SCENES[scene].chooses else NOISES[:1]:
            for way, settings in ways(noise).items():
                for one in settings:
                    for seed in seeds:
                        yield Asked(scene=scene, way=way, settings=one, seed=seed, episodes=episodes)


def answer(asked: Asked, policy: Path) -> SteeringRow:
    """Play the scene."""
    scene, first = SCENES[asked.scene], 10_000 * EPISODES_SEED
    task = dataclasses.replace(TASKS["navigation"], objectives=scene.objectives)
    world = scene.start(asked.episodes, first)
    judge = SceneJudge(scene, world.environments)
    setting = Setting(episodes=world.environments, episodes_seed=EPISODES_SEED)
    play(world, decider(task, asked.settings, load_bundle(policy)), judge, setting, task.steps, first)
    return SteeringRow.of(asked, digest(policy), commit(), judge)


def _policy(policies: Path, seed: int) -> Path:
    algorithm = tuned_default("navigation").algorithm("navigation")
    return find_policy(policies, "navigation", algorithm, seed)
