"""TOML: fleets, objectives, facts, robots' profiles, the harness's faults and limits."""

import re
import shutil
from functools import partial

from paths import ROOT

from edge_runtime.config.fleet import load_fleet
from edge_runtime.config.objectives import load_objective_set
from export.bundle.facts import read_facts
from export.bundle.facts_template import facts_template
from firmware_bridge.can.profile import PROFILES, load_profile
from firmware_bridge.sil.scenario.faults import load_faults
from firmware_bridge.sil.scenario.limits import load_limits
from hostile.values import NUMBERS, TEXTS, change_bytes

FLEETS = ROOT / "edge_runtime" / "fleets"
OBJECTIVES = """
[[objectives]]
type = "speed_limit"
limit_m_s = 0.2
[[objectives]]
type = "geofence"
centre_m = [0.0, 1.0]
radius_m = 0.3
weight = 2.0
[guidance]
mode = "terminal"
scale = 10.0
reach = 0.5
goal_reach = 2.0
goal_within_m = 0.1
requirement_steps = 5
start_noise = 1.0
"""
FAULTS = """
[[fault]]
kind = "loss"
at_s = 1.0
for_s = 2.5
share = 0.3
robots = [0, 1]
[[fault]]
kind = "delay"
at_s = 2.0
for_s = 1.0
delay_ms = 30.0
jitter_ms = 10.0
[[fault]]
kind = "kill"
at_s = 4.0
robot = 1
part = "guard"
[[fault]]
kind = "cpu_hog"
at_s = 5.0
for_s = 1.0
processes = 2
[[fault]]
kind = "objectives"
at_s = 6.0
file = "objectives.toml"
"""
SYNTAX = [
    "[" * 100_000, "a." * 50_000 + "a = 1", "a = " + "[" * 1000 + "]" * 1000, "[[robots]]\n" * 10_000,
    "[[objectives]]\ntype = 'speed_limit'\nlimit_m_s = 1\n" * 3000, "[[", "#" * 10_000,
    '"""', "a = {", "\x00", "= 1",
    "x = " + "9" * 5000, "x = 0x" + "f" * 5000, "x = 1979-05-27T07:32:00Z", "x = nan", "[team]\n[team]",
]  # fmt: skip
NUMERALS = [*map(repr, NUMBERS[:-3]), "nan", "inf", "-inf"]
STRINGS = [f"'{text}'" for text in TEXTS if text.isprintable()]
LITERALS = [*NUMERALS, *STRINGS, "true", "[]", "{}", "[[], []]", "1979-05-27", "[" + "0, " * 5000 + "]"]
NUMBER = re.compile(r"-?[\d.]+(?:e-?\d+)?")
VALUE = re.compile(r"(?<== )[^\n#]+")


def prepare(folder):
    for file in PROFILES.glob("*.dbc"):
        shutil.copy(file, folder)
    bases = [(load_fleet, file.read_text()) for file in FLEETS.glob("*.toml")]
    bases += [(load_profile, file.read_text()) for file in PROFILES.glob("*.toml")]
    limits = (ROOT / "firmware_bridge" / "sil" / "scenario" / "limits.toml").read_text()
    bases += [(load_objective_set, OBJECTIVES), (read_facts, facts_template()), (load_limits, limits)]
    (folder / "objectives.toml").write_text(OBJECTIVES)
    bases += [(partial(load_faults, robots=(0, 1), duration_s=10.0, bridge="can"), FAULTS)]
    return folder / "case.toml", bases


def attempt(draw, given):
    path, bases = given
    load, text = draw.choice(bases)
    for _ in range(draw.randrange(1, 4)):
        text = changed(draw, text)
    content = text.encode("utf-8", "replace")
    path.write_bytes(change_bytes(draw, content) if draw.random() < 0.2 else content)
    load(path)


def another(draw, literal):
    """Another value, of the same kind more often than not."""
    if draw.random() < 0.3:
        return draw.choice(LITERALS)
    if literal.startswith("["):
        return NUMBER.sub(lambda _: draw.choice(NUMERALS), literal, draw.randrange(1, 3))
    return draw.choice(NUMERALS if NUMBER.fullmatch(literal) else STRINGS)


def changed(draw, text):
    lines = text.splitlines()
    at = draw.randrange(len(lines)) if lines else 0
    match draw.randrange(6):
        case 0:
            lines[at : at + 1] = []
        case 1:
            lines[at:at] = lines[at : at + draw.randrange(1, 8)] * draw.choice([1, 1, 50])
        case 2:
            lines[at:at] = [draw.choice(SYNTAX)]
        case 3:
            lines[at:at] = [f"{draw.choice(['x', 'id', 'type', 'key', 'name'])} = {draw.choice(LITERALS)}"]
        case _:
            values = list(VALUE.finditer(text))
            if values:
                found = draw.choice(values)
                return text[: found.start()] + another(draw, found[0].strip()) + text[found.end() :]
    return "\n".join(lines)
