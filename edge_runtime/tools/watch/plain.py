"""The team as plain lines, one a robot, for pipes, logs and scripts."""

import time
from collections.abc import Iterator

from edge_runtime.telemetry.status import Status
from edge_runtime.tools.watch import text
from edge_runtime.tools.watch.team import WatchedTeam


def lines(team: WatchedTeam) -> Iterator[str]:
    """Yield what is known of each robot."""
    stamp = time.strftime("%H:%M:%S")
    for robot_id, heard in team.heard.items():
        known = f"  {_facts(heard.status)}" if heard else ""
        yield f"{stamp}  robot {robot_id}  {text.state(team, robot_id).text}{known}"


def _facts(status: Status) -> str:
    facts = [
        f"goal {text.goal(status).text} m",
        f"speed {text.speed(status).text} m/s",
        f"nearest {text.nearest(status).text} m",
        f"rate {text.rate(status).text} Hz",
        f"missed {status.missed}",
        f"tick {text.milliseconds(status.tick)} ms",
        *(f"{item.name} {text.objective(item).text}" for item in status.objectives),
        f"oldest {1e3 * max(status.ages_s.values(), default=0.0):.0f} ms",
        f"set {status.objectives_version}",
    ]
    if body := text.body(status):
        facts.append(body)
    if status.unfamiliar_ticks:
        facts.append(text.unfamiliar(status))
    if status.stop_reason:
        facts.append(f"stop: {status.stop_reason}")
    return "  ".join(facts)
