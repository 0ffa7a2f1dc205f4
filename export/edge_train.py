"""edge-train: train a policy on a scenario."""

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path

import torch
from torch.distributed.elastic.multiprocessing.errors import ChildFailedError

from edge_runtime.common.command_line import CommandParser
from edge_runtime.errors import ConfigError, EdgeError
from export.distributed import join, launch
from export.scenarios import SCENARIOS
from export.training.plan import ALGORITHMS, Request, make_plan
from export.training.progress import ProgressView
from export.training.run import TrainingRun

EPILOG = """\
exit codes:
  0  trained to the last frame
  1  a worker failed
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

the directory then holds best.pt (for edge-export), checkpoint.pt, metrics.csv and curve.png
"""


def parse(arguments: list[str] | None = None) -> tuple[Request, int]:
    """Return the request and the number of workers to start."""
    options = vars(make_parser().parse_args(arguments))
    workers = options.pop("workers")
    return Request(**options), workers


def make_parser() -> CommandParser:
    """The command line."""
    parser = CommandParser("edge-train", "Train a policy for a team of robots.", EPILOG)
    parser.add_argument("scenario", choices=sorted(SCENARIOS))
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="directory of the run")
    parser.add_argument("--algorithm", choices=sorted(ALGORITHMS), default="mafpo-chain")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames", type=int, metavar="N", help="control steps of the team to train for")
    parser.add_argument(
        "--resume", action="store_true", help="continue the run in DIR from its last checkpoint"
    )
    parser.add_argument(
        "--warm-start", type=Path, metavar="RUN", help="mappo's run that a new mafpo-warm begins with"
    )
    parser.add_argument(
        "--workers", type=int, default=1, metavar="N", help="processes that share the work (1)"
    )
    return parser


def check(request: Request, workers: int) -> None:
    """Refuse numbers that make no sense.

    Raises:
        ConfigError: names the flag.
    """
    if workers < 1:
        raise ConfigError(f"--workers must be at least 1, got {workers}")
    if request.seed < 0:
        raise ConfigError(f"--seed must not be negative, got {request.seed}")
    if request.frames is not None and request.frames < 1:
        raise ConfigError(f"--frames must be at least 1, got {request.frames}")


def _make_directory(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(
            f"--out {out}: no directory can be made there ({error.strerror}); choose another"
        ) from error


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
        with ProgressView(run.trainer.frames, run.total_frames, run.facts.failure) as view:
            run.train(view.show)
        print(f"best validation score {run.best_score:.1%}; next: edge-export {request.out} --out DIR")


def _work_in_group(request: Request) -> EdgeError | None:
    """Return what should end in one line; torchrun's conventions would make a traceback of it."""
    try:
        work(request)
    except EdgeError as error:
        return error
    return None


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit code."""
    try:
        request, workers = parse(arguments)
        check(request, workers)
        _make_directory(request.out)
        if workers > 1:
            make_plan(request, workers)  # one line from here says more than one from every worker
            for refusal in launch(workers, _work_in_group, request).values():
                if refusal:
                    raise refusal
        else:
            work(request)
    except EdgeError as error:
        print(f"edge-train: {error}", file=sys.stderr)
        return 2
    except ChildFailedError as error:
        rank, _ = error.get_first_failure()
        print(f"edge-train: worker {rank} failed, see its message above", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"edge-train: stopped; continue with --resume --out {request.out}", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
