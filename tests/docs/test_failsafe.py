"""The page on what stops a robot states the times and bounds that the code has."""

import re

import pytest
from paths import ROOT

from edge_runtime.config.fleet import OLDEST_STATE_S
from edge_runtime.config.network import CarrierSettings
from edge_runtime.team.membership import STALE_PERIODS
from edge_runtime.team.streams import STALE_S
from firmware_bridge.can.profile import load_profile, profile_path
from firmware_bridge.guard import speeding
from firmware_bridge.guard.core import LONGEST_STOP_S
from firmware_bridge.guard.spec import (
    LONGEST_DEFAULT_DEADLINE_S,
    LONGEST_FIRMWARE_TIMEOUT_S,
    GuardFlags,
    deadline_s,
)

CARRIER = CarrierSettings("team.key")
STATED = {
    "runtime frozen, ": (
        f"{deadline_s(0.02, GuardFlags()) / 0.02:.0f} periods",
        f"{LONGEST_DEFAULT_DEADLINE_S:g} s",
    ),
    "guard killed": (
        f"{load_profile(profile_path('agilex_v2')).firmware_timeout_s:g} s of an AgileX",
        f"more than {LONGEST_FIRMWARE_TIMEOUT_S:g} s",
    ),
    "firmware reports a fault": (f"({load_profile(profile_path('generic')).recoveries} by default)",),
    "measured speed": (
        f"{speeding.SHARE:g} times the limit + {speeding.MARGIN_M_S:g} m/s",
        f"after {speeding.PATIENCE_S:g} s",
    ),
    "a stop sequence that hangs": (f"{LONGEST_STOP_S:g} s",),
    "own pose too old": (f"{OLDEST_STATE_S:g} s at most",),
    "range readings": (f"{STALE_S:g} s",),
    "teammate silent": (f"{STALE_PERIODS} periods",),
    "nobody heard": (f"`alone_s`, {CARRIER.alone_s:g} s",),
    "one teammate missing": (f"`missing_s`, {CARRIER.missing_s:g} s",),
}
"""Words at the beginning of a row, and what it must state."""


@pytest.mark.parametrize("fault", STATED)
def test_the_page_states_the_codes_numbers(fault):
    page = (ROOT / "docs" / "failsafe.md").read_text()
    (row,) = re.findall(rf"^\| {fault}.*$", page, re.MULTILINE)
    assert all(words in row for words in STATED[fault]), row
