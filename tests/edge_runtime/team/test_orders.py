"""Orders in memory: a change of all at one tick, or of none; no order acts twice, late or for another run."""

import itertools
import math
import random

import pytest
from fleet_fakes import KEY, OPERATOR, PERIOD_S, Network, World
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.network.order_wire import Abort, Ask, Commit, Propose, Stop, decode_answer, encode_order
from edge_runtime.network.team_wire import GuideVersions
from edge_runtime.objectives import SpeedLimit
from edge_runtime.team.orders import HOLD_S

SLOW = b'[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 0.1\n'
SLOWER = SLOW.replace(b"0.1", b"0.05")
VALID_S = 5.0


class Operator:
    """Sends single orders through the world's network and reads what comes back."""

    def __init__(self, world, session=1, key=KEY):
        self.world, self.session, self.key = world, session, key
        self.numbers = itertools.count(1)
        self.standings = {}

    def send(self, robot_id, kind, valid_s=VALID_S, **content):
        known = self.standings.get(robot_id)
        boot = known.boot_id if known else 0
        expires_s = self.world.clock(robot_id) + valid_s
        order = kind(self.session, next(self.numbers), robot_id, boot, expires_s, **content)
        self.world.network.carry(OPERATOR, robot_id, encode_order(order, self.key))

    def tell(self, kind, robots=None, **content):
        """Order all of them, let the team tick once, and return what they said by then."""
        for robot_id in robots if robots is not None else self.world.teams:
            self.send(robot_id, kind, **content)
        self.world.tick()
        return self.read()

    def read(self):
        queue = self.world.network.queues.setdefault(OPERATOR, [])
        while queue:
            standing = decode_answer(queue.pop(0), self.key)
            if standing.session == self.session:
                self.standings[standing.robot_id] = standing
        return self.standings

    def until(self, kind, stage, **content):
        """Repeat an order, for packets are lost, until all are at a stage."""
        for _ in range(1000):
            answers = self.tell(kind, **content)
            if {standing.stage for standing in answers.values()} == {stage}:
                return
            self.world.end_checks()
        raise AssertionError({robot: standing.stage for robot, standing in answers.items()})

    def propose(self, content=SLOW, version=1):
        return self.tell(Propose, version=version, file="slow.toml", content=content)

    def prepare(self, content=SLOW, version=1):
        self.until(Propose, "accepted", version=version, file="slow.toml", content=content)


def versions(world):
    return {robot_id: team._orders.guide.version for robot_id, team in world.teams.items()}


@pytest.fixture
def ready():
    """Three robots that have found each other, and an operator who knows them."""
    world = World(3)
    world.network.queues[OPERATOR] = []
    world.ticks(5)
    operator = Operator(world)
    operator.tell(Ask)
    return world, operator


def test_a_change_is_followed_by_all_from_the_same_tick_on(ready):
    world, operator = ready
    operator.prepare()
    tick = world.teams[0].tick + 20
    operator.tell(Commit, tick=tick)
    assert {standing.stage for standing in operator.standings.values()} == {"committed"}
    while world.teams[0].tick < tick + 5:
        world.tick()
        for team in world.teams.values():
            changed = team.tick >= tick
            assert team._orders.guide.version == changed
            guide = team.new_guide()
            assert (guide is not None) == (team.tick == tick)
            if guide:
                assert guide.asked.objectives == (SpeedLimit(limit_m_s=0.1),)
                assert [objective.limit_m_s for objective in guide.objectives] == [0.1]
    assert operator.tell(Ask)[0].stage == "applied"
    assert world.teams[0].report().disagreed == {}
    assert world.teams[0].report().own_objectives_version == 1


def test_what_one_refuses_none_follows(ready):
    world, operator = ready
    operator.until(Propose, "refused", version=1, file="slow.toml", content=SLOW.replace(b"0.1", b"nan"))
    complaint = operator.standings[2].complaint
    assert complaint == "slow.toml: objectives[0].limit_m_s: must be a finite number, got nan"
    operator.tell(Commit, tick=1)
    world.ticks(5)
    assert versions(world) == {0: 0, 1: 0, 2: 0}


def test_an_aborted_proposal_cannot_be_committed(ready):
    world, operator = ready
    operator.prepare()
    operator.tell(Abort)
    assert operator.standings[0].stage == "none"
    operator.tell(Commit, tick=1)
    world.ticks(5)
    assert versions(world) == {0: 0, 1: 0, 2: 0}


def test_a_commitment_cannot_be_aborted(ready):
    world, operator = ready
    operator.prepare()
    tick = world.teams[0].tick + 10
    operator.tell(Commit, tick=tick)
    operator.tell(Abort)
    operator.tell(Commit, tick=tick + 1000)
    world.ticks(10)
    assert versions(world) == {0: 1, 1: 1, 2: 1}


@pytest.mark.parametrize("forged", [2**53, 50_000])
def test_what_a_teammate_says_of_a_commitment_does_not_put_it_off(ready, forged):
    world, operator = ready
    operator.prepare()
    orders = world.teams[0]._orders
    digest = orders._proposal.agreed.guide.digest
    orders.heard(GuideVersions(next_digest=digest, next_tick=forged), world.teams[0].tick)
    operator.tell(Commit, tick=world.teams[0].tick + 10)
    world.ticks(12)
    assert versions(world) == {0: 1, 1: 1, 2: 1}


def test_a_commitment_reaches_all_through_any_of_them(ready):
    """The operator dies after one robot has heard the commitment."""
    world, operator = ready
    operator.prepare()
    tick = world.teams[0].tick + 10
    operator.tell(Commit, robots=[1], tick=tick)
    while world.teams[0].tick < tick + 3:
        world.tick()
        assert len({team._orders.guide.version for team in world.teams.values()}) == 1
    assert versions(world) == {0: 1, 1: 1, 2: 1}


def test_who_hears_of_it_too_late_changes_at_once(ready):
    world, operator = ready
    operator.prepare()
    world.network.dead.add(2)
    operator.tell(Commit, robots=[0, 1], tick=world.teams[0].tick + 3)
    world.ticks(10)
    assert versions(world) == {0: 1, 1: 1, 2: 0}
    world.network.dead.clear()
    world.ticks(3)
    assert versions(world) == {0: 1, 1: 1, 2: 1}


@pytest.mark.parametrize("longer", [0, 1000])
def test_who_missed_it_altogether_is_seen_by_all(ready, longer):
    world, operator = ready
    operator.until(Ask, "none")
    world.network.dead.add(2)
    operator.tell(Propose, robots=[0, 1], version=1, file="slow.toml", content=SLOW)
    world.end_checks()
    world.ticks(longer)
    operator.tell(Commit, robots=[0, 1], tick=1)
    world.network.dead.clear()
    *_, last = world.ticks(10)
    assert versions(world) == {0: 1, 1: 1, 2: 0}
    assert world.teams[0].report().disagreed.keys() == world.teams[1].report().disagreed.keys() == {2}
    assert world.teams[2].report().disagreed.keys() == {0, 1}
    assert all(view.fault == "" for view in last.values())  # they had agreed: it is counted, not stopped


def test_a_team_that_never_agreed_does_not_drive():
    world = World(3, asked={1: ObjectiveSet((SpeedLimit(limit_m_s=0.2),))})
    *_, last = world.ticks(10)
    assert last[0].fault == last[2].fault == "robot 1 follows other objectives than this one"
    assert last[1].fault == "robot 0 follows other objectives than this one"


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), spoken=st.integers(1, 30))
def test_nobody_is_half_way_whatever_is_lost_and_whenever_the_operator_dies(seed, spoken):
    """A fifth of all packets is lost; of the commitments the operator sends only so many."""
    world = World(4, Network(loss=0.2, seed=seed))
    world.network.queues[OPERATOR] = []
    world.ticks(10)
    operator = Operator(world)
    while len(operator.standings) < 4:
        operator.tell(Ask)
    operator.prepare()
    tick = world.teams[0].tick + 50
    draw = random.Random(seed)
    for _ in range(spoken):
        operator.send(draw.randrange(4), Commit, tick=tick)
        world.tick()
    while max(team.tick for team in world.teams.values()) < tick + 20:
        followed = {team._orders.guide.version for team in world.teams.values() if team.tick >= tick}
        assert len(followed) <= 1
        assert all(team._orders.guide.version == 0 for team in world.teams.values() if team.tick < tick)
        world.tick()


def test_two_operators_do_not_mix(ready):
    world, first = ready
    second = Operator(world, session=2)
    second.tell(Ask)
    first.prepare()
    second.propose(SLOWER)
    assert {standing.stage for standing in second.standings.values()} == {"refused"}
    assert second.standings[0].complaint == "another operator's objectives or policy are on their way"
    second.tell(Commit, tick=1)
    world.ticks(3)
    assert versions(world) == {0: 0, 1: 0, 2: 0}
    world.now_s += HOLD_S  # the first one never came back
    world.ticks(5)
    second.prepare(SLOWER)
    second.tell(Commit, tick=1)
    world.ticks(3)
    assert world.teams[0]._orders.guide.asked.objectives == (SpeedLimit(limit_m_s=0.05),)


def test_versions_only_rise(ready):
    world, operator = ready
    operator.prepare(version=5)
    operator.tell(Commit, tick=1)
    world.ticks(2)
    other = Operator(world, session=2)
    other.tell(Ask)
    other.propose(SLOWER, version=5)
    assert other.standings[1].complaint == "version 5 is not above 5, which it follows"


def test_a_stop_is_for_good_and_says_so_at_the_end(ready):
    world, operator = ready
    operator.send(1, Stop)
    view = world.tick()[1]
    assert view.fault == world.teams[1].stop_reason == "stopped by edge-ctl"
    assert operator.read()[1].stopped
    operator.tell(Ask, robots=[1])
    assert world.tick()[1].fault == "stopped by edge-ctl"
    world.network.queues[OPERATOR].clear()
    with world.teams[1]:
        pass
    assert len(world.network.queues[OPERATOR]) >= 3
    assert operator.read()[1].stopped


def test_recorded_orders_do_nothing_in_another_run_or_later(ready):
    world, operator = ready
    expires_s = world.clock(0) + 1.0
    order = Stop(1, 99, 0, operator.standings[0].boot_id, expires_s)
    propose = Propose(1, 98, 0, operator.standings[0].boot_id, expires_s, version=1, file="f", content=SLOW)
    recorded = [encode_order(order, KEY), encode_order(propose, KEY)]
    world.now_s += 1.1  # held back by an attacker until now
    world.network.queues[0].extend(recorded)
    world.ticks(3)
    assert world.teams[0].stop_reason == ""
    assert world.teams[0].report().refused["expired"] == 2
    world.now_s -= 1.1
    world.teams[0] = world.make(0, nonces=itertools.count(77))
    world.network.queues[0].extend(recorded)
    world.ticks(3)
    assert world.teams[0].stop_reason == "" and world.teams[0]._orders._proposal is None
    assert world.teams[0].report().refused["expired"] == 2


@pytest.mark.parametrize("valid_s", [math.nan, math.inf, 1e300, 60.0, -0.1])
def test_no_order_holds_for_ever(ready, valid_s):
    world, operator = ready
    operator.send(0, Stop, valid_s=valid_s)
    world.ticks(3)
    assert world.teams[0].stop_reason == ""
    refused = world.teams[0].report().refused
    assert refused.get("expired", 0) + refused.get("malformed", 0) == 1


def test_orders_for_others_and_by_others_are_refused(ready):
    world, operator = ready
    stranger = Operator(world, key=b"x" * 32)
    stranger.standings = operator.standings
    for kind in (Ask, Stop, Abort):
        stranger.send(0, kind)
    operator.send(1, Stop)
    world.network.queues[0].append(world.network.queues[1].pop())
    before = len(world.network.queues[OPERATOR])
    world.tick()
    refused = world.teams[0].report().refused
    assert (refused["foreign"], refused["misdirected"]) == (3, 1)
    assert world.teams[0].stop_reason == ""
    assert len(world.network.queues[OPERATOR]) == before


def test_a_user_objective_that_fails_while_it_is_loaded_is_a_refusal(ready):
    _, operator = ready
    operator.until(
        Propose, "refused", version=1, file="mine.toml", content=b'[[objectives]]\ntype = "nowhere:Mine"\n'
    )
    assert "cannot import 'nowhere:Mine'" in operator.standings[0].complaint


def test_the_answer_tells_how_the_robot_stands(ready):
    world, operator = ready
    world.ticks(int(2.0 / PERIOD_S))
    standing = operator.tell(Ask)[2]
    assert standing.tick == world.teams[2].tick
    assert standing.rate_hz == pytest.approx(1 / PERIOD_S, rel=0.05)
    assert standing.nominal_rate_hz == pytest.approx(1 / PERIOD_S)
    assert (standing.version, standing.stop_reason, standing.stopped) == (0, "", False)
