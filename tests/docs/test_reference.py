"""The pages of reference: made from the code, whole and true."""

import html
import re
import zlib

import msgspec
import pytest

import edge_runtime
from edge_runtime import objectives
from edge_runtime.common.commands import COMMANDS
from edge_runtime.config.fleet import Team
from edge_runtime.config.network import CarrierSettings, Robot
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.objectives import BUILT_IN
from edge_runtime.observation import SOURCES
from edge_runtime.recording.schema import CHANNELS
from firmware_bridge.can.profile import Feedback, Profile
from firmware_bridge.ros.profile import RosProfile
from firmware_bridge.sil.scenario.faults import KINDS
from firmware_bridge.sil.scenario.limits import MachineLimits, RunLimits

RECORDS = {
    "fleet-file": (Team, Robot, CarrierSettings, GuidanceSettings),
    "objectives": BUILT_IN,
    "profile-file": (Feedback, Profile),
    "ros-profile-file": (RosProfile,),
    "sil-files": (*KINDS, RunLimits, MachineLimits),
    "sources": SOURCES,
    "log": [record for _, record in CHANNELS.values()],
}
"""Pages, and records whose keys they must have."""


def page(site, name):
    return html.unescape((site / name / "index.html").read_text())


def public_names():
    """What programs of one's own may build on, with what its classes offer."""
    for name in edge_runtime.__all__:
        yield f"edge_runtime.{name}"
        found = getattr(edge_runtime, name)
        members = vars(found) if isinstance(found, type) else ()
        yield from (f"edge_runtime.{name}.{member}" for member in members if not member.startswith("_"))
    yield from (f"edge_runtime.objectives.{name}" for name in {*objectives.__all__} - {*edge_runtime.__all__})


def test_no_public_name_is_without_reference(site):
    *_, packed = (site / "objects.inv").read_bytes().split(b"\n", 4)
    described = {line.partition(" ")[0] for line in zlib.decompress(packed).decode().splitlines()}
    assert {*public_names()} <= described


@pytest.mark.parametrize("name", RECORDS)
def test_every_key_of_a_file_is_on_its_page(site, name):
    text = page(site, name)
    for record in RECORDS[name]:
        for field in msgspec.inspect.type_info(record).fields:
            name = field.encode_name
            assert f"<code>{name}</code>" in text or f".{name}]" in text or f"[{name}" in text, record


def test_the_ranges_on_the_page_are_those_that_the_program_takes(site):
    section = page(site, "fleet-file").partition("<code>[team]</code></h3>")[2].partition("</table>")[0]
    rows = [
        re.search(r"<code>(\w+)</code>.*>in \[(.+), (.+)\]<", row, re.DOTALL) for row in section.split("<tr>")
    ]
    ranges = [row.groups() for row in rows if row]
    assert {key for key, _, _ in ranges} >= {"rate_hz", "goal_tolerance_m", "slew_per_s"}
    for key, *ends in ranges:
        low, high = map(float, ends)
        for within in (low, high):
            msgspec.convert({key: within}, Team)
        for beyond in (low - 1.0, high + 1.0):
            with pytest.raises(msgspec.ValidationError, match=key):
                msgspec.convert({key: beyond}, Team)


def test_the_help_of_every_command_is_on_its_page(site):
    text = page(site, "commands")
    assert all(f"usage: {name} " in text for name in COMMANDS if name not in ("edge-train", "edge-export"))


def test_nothing_that_a_page_asks_of_the_code_is_left_out(site):
    assert not [path for path in site.rglob("*.html") if re.search(r"<!-- \w+: |<!-- help", path.read_text())]
