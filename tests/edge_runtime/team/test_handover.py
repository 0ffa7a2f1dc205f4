"""A policy on its way to robots in memory: what they take in, when they stand; all change, or none."""

import itertools
import random
from pathlib import Path
from types import SimpleNamespace

import pytest
from bundles import MANIFEST, write_straight_bundle
from fleet_fakes import KEY, OPERATOR, PERIOD_S, World
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.errors import BundleError, ConfigError
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.motion.models import VelocityLag
from edge_runtime.network.order_wire import (
    Abort,
    Ask,
    Chunk,
    Commit,
    Halt,
    Offer,
    Propose,
    decode_answer,
    encode_order,
)
from edge_runtime.policy.bundle import Bundle, load_bundle
from edge_runtime.policy.signature import sign
from edge_runtime.team.handover import (
    LARGEST_BUNDLE,
    PolicyReceiver,
    Reception,
    _require_same_robot,
    bundle_files,
)
from edge_runtime.team.orders import HALT_S, HANDOVER

FILES = {"manifest.json": b"{}", "manifest.sha256": b"abc", "policy.npz": bytes(range(256)) * 100}
SIZES = tuple((name, len(content)) for name, content in FILES.items())
STREAM = b"".join(FILES.values())
SEED = bytes(range(32))
ORDER = (1, 1, 0, 0, 0.0)


@given(
    st.lists(st.tuples(st.integers(0, len(STREAM)), st.integers(0, 9000)), max_size=30),
    st.integers(0, 2**32),
)
def test_whatever_comes_in_whatever_order_only_what_was_sent_is_taken(pieces, seed):
    reception = Reception(Offer(*ORDER, version=1, files=SIZES))
    for begin, size in pieces:
        reception.take(Chunk(*ORDER, offset=begin, content=STREAM[begin : begin + size]))
        assert not reception.complete or reception.files() == FILES
    draw = random.Random(seed)
    begins = list(range(0, len(STREAM), 5000))
    while not reception.complete:
        begin = draw.choice([*begins, reception.received])
        reception.take(Chunk(*ORDER, offset=begin, content=STREAM[begin : begin + 5000]))
    reception.take(Chunk(*ORDER, offset=len(STREAM), content=b"more"))
    assert reception.files() == FILES


@pytest.mark.parametrize(("files", "said"), [
    ((("../team.key", 3),), "a policy has the files manifest.json, "),
    ((("/etc/passwd", 3),), "a policy has the files manifest.json, "),
    ((("policy.npz", 3), ("policy.npz", 4)), "a policy has the files manifest.json, "),
    ((("policy.npz", LARGEST_BUNDLE + 1),), "is too large"),
])  # fmt: skip
def test_files_that_no_bundle_has_are_refused_before_they_come(files, said):
    with pytest.raises(ConfigError, match=said):
        Reception(Offer(*ORDER, version=1, files=files))


def test_nobody_takes_a_policy_where_no_key_is_trusted():
    fleet = load_fleet(DEFAULT_FLEET)
    receiver = PolicyReceiver(Mission(0, fleet, Bundle(MANIFEST, None, Path()), fleet.objective_set, 10.0))
    with pytest.raises(ConfigError, match="names no trusted_keys"):
        receiver(FILES, ObjectiveSet())


class Operator:
    """Sends an order to each robot and lets the team tick; returns their answers."""

    def __init__(self, world, session=7):
        self.world, self.session, self.numbers = world, session, itertools.count(1)
        self.standings = {}

    def tell(self, kind, **content):
        for robot_id in self.world.teams:
            boot = self.standings[robot_id].boot_id if robot_id in self.standings else 0
            expires_s = self.world.clock(robot_id) + 5.0
            order = kind(self.session, next(self.numbers), robot_id, boot, expires_s, **content)
            self.world.network.carry(OPERATOR, robot_id, encode_order(order, KEY))
        seen = self.world.tick()
        queue = self.world.network.queues[OPERATOR]
        while queue:
            standing = decode_answer(queue.pop(0), KEY)
            if standing.session == self.session:
                self.standings[standing.robot_id] = standing
        return seen

    def stages(self):
        return {standing.stage for standing in self.standings.values()}

    def until(self, stages):
        self.world.end_checks()
        self.tell(Ask)
        assert self.stages() == stages

    def offer(self):
        self.tell(Offer, version=1, files=SIZES)
        assert self.stages() == {"receiving"}
        for begin in range(0, len(STREAM), 8192):
            self.tell(Chunk, offset=begin, content=STREAM[begin : begin + 8192])


def prepared(world, robot_id, refusing=()):
    """What a robot makes of the files: a policy of its own kind, or a refusal."""

    def prepare(files, asked):
        assert files == FILES
        if robot_id in refusing:
            raise ConfigError("no such rays")
        guide = world.teams[robot_id]._orders.guide
        mission = SimpleNamespace(guide_of=world.guide_of, bundle=Bundle(MANIFEST, None, Path(), "ab" * 32))
        controller = SimpleNamespace(guide=replace(guide, asked=asked))
        return SimpleTakeover(mission, controller)

    return prepare


class SimpleTakeover(SimpleNamespace):
    digest = 0xABABABABABABABAB

    def __init__(self, mission, controller):
        super().__init__(mission=mission, controller=controller)


@pytest.fixture
def ready():
    """Three robots that have found each other, and an operator who knows them."""
    world = World(3)
    world.network.queues[OPERATOR] = []
    world.ticks(5)
    for robot_id, team in world.teams.items():
        team._orders._prepare_policy = prepared(world, robot_id)
    operator = Operator(world)
    operator.tell(Ask)
    return world, operator


def faults(seen):
    return {team.fault for team in seen.values()}


def test_all_stand_before_the_tick_and_run_it_from_then_on(ready):
    world, operator = ready
    operator.offer()
    operator.until({"accepted"})
    assert faults(operator.tell(Ask)) == {""}  # they drive on while it is checked
    operator.tell(Halt)
    assert faults(operator.tell(Halt)) == {HANDOVER}
    tick = world.teams[0].tick + 20
    operator.tell(Commit, tick=tick)
    while world.teams[0].tick < tick - 1:
        assert faults(world.tick()) == {HANDOVER}
    world.ticks(3)
    assert faults(world.tick()) == {""}
    for team in world.teams.values():
        assert team.takeover().digest == SimpleTakeover.digest
        assert (team._orders.guide.version, team._guide_tick) == (1, tick)
    operator.tell(Ask)
    assert {standing.policy for standing in operator.standings.values()} == {"straight abababababab"}


def test_later_objectives_are_those_of_the_new_policy(ready):
    """And who still runs the old one is told from the others."""
    world, operator = ready
    before = world.teams[0]._orders.guide.digest
    operator.offer()
    operator.until({"accepted"})
    operator.tell(Commit, tick=world.teams[0].tick + 1)
    world.ticks(5)
    assert world.teams[0]._orders.guide.digest == before ^ SimpleTakeover.digest
    other = Operator(world, session=8)
    other.tell(Ask)
    other.tell(Propose, version=2, file="none.toml", content=b"objectives = []")
    other.until({"accepted"})
    other.tell(Commit, tick=world.teams[0].tick + 1)
    world.ticks(5)
    assert world.teams[0]._orders.guide.digest == before ^ SimpleTakeover.digest


def test_one_refuses_and_nobody_changes(ready):
    world, operator = ready
    world.teams[2]._orders._prepare_policy = prepared(world, 2, refusing=(2,))
    operator.offer()
    operator.until({"accepted", "refused"})
    assert operator.standings[2].complaint == "no such rays"
    operator.tell(Halt)
    operator.tell(Abort)
    assert faults(world.ticks(2)[-1]) == {""}
    assert [team.takeover() for team in world.teams.values()] == [None] * 3
    assert {team._orders.guide.version for team in world.teams.values()} == {0}


def test_robots_whose_operator_is_gone_drive_on_with_what_they_have(ready):
    world, operator = ready
    operator.offer()
    operator.until({"accepted"})
    operator.tell(Halt)
    assert faults(world.tick()) == {HANDOVER}
    world.ticks(round(HALT_S / PERIOD_S) + 1)
    assert faults(world.tick()) == {""}
    assert world.teams[0].takeover() is None


def test_what_is_not_whole_is_neither_checked_nor_committed(ready):
    world, operator = ready
    operator.tell(Offer, version=1, files=SIZES)
    operator.tell(Chunk, offset=0, content=STREAM[:8192])
    operator.tell(Chunk, offset=16384, content=STREAM[16384:])
    operator.tell(Commit, tick=world.teams[0].tick + 1)
    world.ticks(5)
    operator.tell(Ask)
    assert operator.stages() == {"receiving"}
    assert {standing.received for standing in operator.standings.values()} == {8192}
    assert world.teams[0].takeover() is None


@pytest.mark.parametrize(("changes", "what"), [
    ({"body": replace(MANIFEST.body, lidar_rays=8)}, "body"),
    ({"action": tuple(replace(field, high=2.0) for field in MANIFEST.action)}, "action"),
    ({"motion": replace(MANIFEST.motion, mass_kg=2.0)}, "motion model"),
    ({"motion": VelocityLag(dt_s=MANIFEST.motion.dt_s)}, "motion model"),
])  # fmt: skip
def test_the_policy_of_another_robot_is_refused(changes, what):
    with pytest.raises(BundleError, match=f"is for another robot than 'straight': its {what} differs"):
        _require_same_robot(MANIFEST, replace(MANIFEST, name="other", **changes), PERIOD_S)


def test_what_the_link_takes_limits_a_policy_that_is_handed_over_too(tmp_path, monkeypatch):
    nacl = pytest.importorskip("nacl.bindings")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    directory = write_straight_bundle(tmp_path / "newer")
    bundle = load_bundle(directory)
    sign(directory, bundle.sha256, 1, SEED)
    key = nacl.crypto_sign_seed_keypair(SEED)[0].hex()
    (tmp_path / "team.toml").write_text(
        f'[team]\ntrusted_keys = ["{key}"]\n[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\n'
    )
    fleet = load_fleet(tmp_path / "team.toml")
    receiver = PolicyReceiver(Mission(0, fleet, bundle, fleet.objective_set, 10.0), 0.5, 0.7)
    limits = receiver(bundle_files(load_bundle(directory)), fleet.objective_set).controller.limits
    assert (limits.max_speed_m_s, limits.max_yaw_rate_rad_s) == (0.5, 0.7)
