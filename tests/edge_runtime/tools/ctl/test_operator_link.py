"""The operator's end by itself: what one robot says does not decide for all."""

import time

import pytest

from edge_runtime.network.order_wire import Standing
from edge_runtime.tools.ctl.operator_link import OperatorLink


@pytest.fixture
def link():
    with OperatorLink(dict.fromkeys(range(3), ("127.0.0.1", 9)), bytes(32), 1.0) as opened:
        yield opened


def answer(link, robot_id, tick, arrival_s):
    numbers = (robot_id, 7, arrival_s, tick, 50.0, 50.0, 0, 0)
    link._take(Standing(link.session, 1, *numbers, "none", "", "", False), arrival_s)


@pytest.mark.parametrize("lie", [0, 2**53, 2**62])
def test_a_change_is_planned_by_those_that_agree(link, lie):
    now_s = time.monotonic()
    for robot_id, tick in enumerate((1000, lie, 1001)):
        answer(link, robot_id, tick, now_s)
    planned, later_s = link.tick_in(1.0), time.monotonic() - now_s
    assert 1000 + 50 <= planned <= 1001 + 50 * (2.0 + later_s)
