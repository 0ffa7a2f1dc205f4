"""edge-train: train a policy on a scenario."""

import contextlib
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch
from torch.distributed.elastic.multiprocessing.errors import ChildFailedError

from edge_runtime.common.command_line import CommandParser, command, complain
from edge_runtime.common.flag_types import whole_number
from edge_runtime.common.streams import lost
from edge_runtime.errors import EdgeError, FailedError
from export.algorithms.base import TrainingSettings
from export.common.distributed import join, launch
from export.scenarios import SCENARIOS
from export.training.lock import locked
from export.training.progress import ProgressView
from export.training.request import ALGORITHMS, Request, check_request
from export.training.run import TrainingRun

NUMBER, COUNT = whole_number(0, 2**63 - 1), whole_number(1, 2**63 - 1)
EPILOG = """\
exit codes:
  0  trained to the last frame
  1  a worker failed, or training came apart
  2  a flag, file or run does not hold together; one line says what
  130  interrupted; --resume continues

examples:
  edge-train navigation --seed 0 --out runs/nav
  edge-train navigation --out runs/nav --resume              after an interruption, however abrupt
  edge-train navigation --algorithm mafpo --seed 1 --out runs/mafpo-1     the ratio of eq. 8
  edge-train navigation --algorithm mappo --out runs/mappo                the paper's Gaussian baseline
  edge-train balance --algorithm mafpo-warm --warm-start runs/mappo --out runs/warm   a flow that begins as it
  edge-train navigation --algorithm pc-mappo --out runs/pc-mappo          the same, told its objectives
  edge-train navigation --out runs/nav --workers 2           two processes, one policy

what to expect of mafpo-chain alone, mean of five seeds:
  navigation  1 % of the episodes succeed after 128,000 frames, 96 % after 256,000, 96 % after 704,000
  balance     a score of 42 % after 640,000, 66 % after 1,280,000, 81 % after 2,009,600; 90 % of it success
  sampling    61 samples an episode of 10 s after 256,000, 76 after 512,000, 82 after 908,800
guided as well, docs/policy.md says; balance's guided flows are better from mafpo-warm. How long that takes on
your machine, the line of the training's progress says.

the directory then holds best.pt (for edge-export), checkpoint.pt, metrics.csv and curve.png
"""


def parse(arguments: Sequence[str] | None = None) -> tuple[Request, int]:
    """Return the request and the number of workers to start."""
    options = vars(make_parser().parse_args(arguments))
    workers = options.pop("workers")
    return Request(**options), workers


def make_parser() -> CommandParser:
    """The command line."""
    parser = CommandParser("edge-train", "Train a policy for a team of robots.", EPILOG)
    add = parser.add_argument
    add("scenario", choices=sorted(SCENARIOS), help="the task")
    add("--out", type=Path, required=True, metavar="DIR", help="directory of the run")
    add("--algorithm", choices=sorted(ALGORITHMS), default="mafpo-chain", help="(default: %(default)s)")
    add("--seed", type=NUMBER, default=0, metavar="N", help="of all that is drawn (default: %(default)s)")
    add("--frames", type=COUNT, metavar="N", help=f"control steps of the team (default: {_default_frames()})")
    add("--resume", action="store_true", help="continue the run in DIR from its last checkpoint")
    add("--warm-start", type=Path, metavar="RUN", help="mappo's run that a new mafpo-warm begins with")
    add(
        "--workers", type=COUNT, default=1, metavar="N", help="processes that share it (default: %(default)s)"
    )
    return parser


def _default_frames() -> str:
    """What every algorithm trains for unless told otherwise; the commonest number first, for all others."""
    frames = {name: algorithm.settings.frames for name, algorithm in ALGORITHMS.items()}
    common = max(set(frames.values()), key=list(frames.values()).count)
    others = [f"{name}: {count}" for name, count in frames.items() if count != common]
    return ", ".join([str(common), *others])


@contextlib.contextmanager
def _denormals_flushed() -> Iterator[None]:
    """Tiny numbers as zeros, for speed; it is the whole process's state, so it is put back."""
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)


def work(request: Request) -> None:
    """Train as one worker, alone or in the group that torchrun made."""
    # The matrices are small: further threads only contend, and sums stay in one order.
    torch.set_num_threads(1)
    with _denormals_flushed(), join() as workers:
        run = TrainingRun(request, workers)
        if not workers.leads:
            run.train(lambda _row: None)
            return
        with ProgressView(run.trainer.frames, run.trainer.settings.whole_frames, run.facts.failure) as view:
            run.train(view.show)
        print(f"best validation score {run.best_score:.1%}; next: edge-export {request.out} --out DIR")


def _work_in_group(request: Request) -> EdgeError | OSError | None:
    """Return what should end in one line; torchrun's conventions would make a traceback of it."""
    try:
        work(request)
    except (EdgeError, OSError) as error:
        return error
    finally:
        lost(sys.stdout)
    return None


def _tell_rounding(settings: TrainingSettings, request: Request) -> None:
    if request.frames not in (None, settings.whole_frames):
        complain(
            "edge-train",
            f"--frames {request.frames} is rounded up to {settings.whole_frames}: an update "
            f"takes {settings.environments * settings.steps}",
        )


def _train(request: Request, workers: int) -> None:
    """Train in this process, or in ``workers`` others."""
    if workers == 1:
        work(request)
        return
    for refusal in launch(workers, _work_in_group, request).values():
        if refusal:
            raise refusal


@command("edge-train")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-train``; returns the exit code."""
    request, workers = parse(arguments)
    _tell_rounding(check_request(request, workers).settings, request)
    try:
        with locked(request.out):
            _train(request, workers)
    except ChildFailedError as error:
        rank, _ = error.get_first_failure()
        raise FailedError(f"worker {rank} failed, see its message above") from error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"stopped; continue with --resume --out {request.out}") from None
    return 0


if __name__ == "__main__":
    sys.exit(main())
