"""``python -m benchmarks failsafe``: how far a robot travels after each fault, as a table of the docs.

What is specified comes from `edge_runtime.control.stopping`, the packaged profiles and the guard's defaults;
what was measured, from the rows of ``python -m benchmarks faults``. Nothing is measured here.
"""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.common.flags import add_result, make_parser
from benchmarks.common.result_file import read_result
from benchmarks.common.result_page import table
from benchmarks.faults.faults_command import RESULTS
from benchmarks.faults.robot import PERIOD_S, SPEED_M_S, MavlinkRobot
from benchmarks.faults.rows import FaultRow
from edge_runtime.common.command_line import check_writable
from edge_runtime.control.bridge import Reaction
from edge_runtime.control.stopping import Travel, travels
from edge_runtime.errors import ConfigError
from firmware_bridge.can.profile import load_profile, profile_path
from firmware_bridge.guard.spec import GuardFlags, deadline_s
from firmware_bridge.mavlink.profiles import PROFILES

PAGE = Path(__file__).parents[2] / "docs" / "failsafe.md"
BEGIN, END = "<!-- python -m benchmarks failsafe -->\n", "<!-- end -->"
PX4_TIMEOUT_S = 1.0
"""COM_OF_LOSS_T as PX4 comes."""
FAULTS = {
    "runtime dead": ("the guard, at once", "kill -9 of the runtime"),
    "runtime frozen": ("the guard, after its deadline", "SIGSTOP of the runtime"),
    "guard dead": ("the firmware, after its timeout", "kill -9 of the guard"),
    "link cut": ("the firmware, after its timeout", "link cut"),
}
"""Who stops the robot, and what the rows call the fault."""


def robots() -> dict[str, tuple[float, Reaction]]:
    """Return deceleration and reaction of some robots, by the heads of their columns."""
    deadline = deadline_s(PERIOD_S, GuardFlags())
    chassis = load_profile(profile_path("agilex_v2"))
    autopilots = {
        f"px4, COM_OF_LOSS_T {PX4_TIMEOUT_S:g} s": PX4_TIMEOUT_S,
        "ardupilot_rover as it comes": PROFILES["ardupilot_rover"].fixed_timeout_s,
    }
    found = {"agilex_v2": (chassis.stop.deceleration_m_s2 or 0.0, chassis.firmware_timeout_s)}
    found |= {name: (MavlinkRobot.braking_m_s2, timeout_s) for name, timeout_s in autopilots.items()}
    return {
        name: (deceleration, Reaction(deadline, timeout_s, deceleration))
        for name, (deceleration, timeout_s) in found.items()
    }


def failsafe_table(rows: Sequence[FaultRow]) -> str:
    """Format what each fault costs as a Markdown table."""
    costs = {
        name: {one.fault: one for one in travels(SPEED_M_S, deceleration, reaction)}
        for name, (deceleration, reaction) in robots().items()
    }
    measured = {(row.fault, row.bridge): row for row in rows}
    lines = [
        [fault, who, *(_specified(cost[fault]) for cost in costs.values())]
        + [_measured(measured.get((row, bridge))) for bridge in ("can", "mavlink")]
        for fault, (who, row) in FAULTS.items()
    ]
    return table(["fault", "who stops it", *costs, "measured, CAN", "measured, MAVLink"], lines)


def _specified(travel: Travel) -> str:
    if travel.seconds is None or travel.metres is None:
        return "never"
    return f"{1e3 * travel.seconds:.0f} ms, {travel.metres:.2f} m"


def _measured(row: FaultRow | None) -> str:
    if row is None or row.p95_ms is None:
        return "-"
    return f"{row.p95_ms:.0f} ms" + ("" if row.p95_m is None else f", {row.p95_m:.2f} m")


def main(arguments: Sequence[str]) -> int:
    """Print the table and put it into its page."""
    parser = make_parser("failsafe", __doc__)
    add_result(parser, RESULTS)
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE", help="where the table stands")
    options = parser.parse_args(arguments)
    text = failsafe_table(read_result(options.json, list[FaultRow], default=[]))
    page = options.page.read_text()
    head, begin, rest = page.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        raise ConfigError(f"--page {options.page}: has no lines {BEGIN.strip()!r} and {END!r} around a table")
    check_writable(options.page)
    options.page.write_text(f"{head}{BEGIN}\n{text}\n\n{END}{tail}")
    print(text)
    return 0
