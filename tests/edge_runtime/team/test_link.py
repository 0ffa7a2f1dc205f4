"""Teams of processes on a network in memory: who is seen, who is masked, who stops and goes on."""

import itertools

import pytest
from fleet_fakes import KEY, PERIOD_S, Network, World, ids
from msgspec.structs import replace

from edge_runtime.messages import Command


def test_a_team_finds_itself_within_four_ticks_and_waits_until_then():
    world = World(4)
    first, *_, last = world.ticks(4)
    assert first[1].fault == "waits for robots 0, 2, 3: not heard yet"
    assert first[1].teammates == ()
    for robot_id, view in last.items():
        assert ids(view) == [other for other in range(4) if other != robot_id]
        assert view.fault == ""


def test_what_arrives_is_what_was_sent_in_the_receivers_clock():
    world = World(2)
    *_, last = world.ticks(5)
    (mate,) = last[0].teammates
    assert mate.state.position_m == (1.0, 0.0)
    assert mate.state.velocity_m_s == (0.1, 0.2)
    assert mate.state.heading_rad == 0.3
    assert mate.intended_action == (0.5, -0.5)
    assert mate.state.stamp_s == pytest.approx(last[0].own.stamp_s - mate.age_s)


def test_a_killed_neighbour_is_masked_within_three_periods_and_missed_later():
    world = World(3, missing_s=1.0)
    world.ticks(5)
    world.network.dead.add(2)
    seen = [views[0] for views in world.ticks(60)]
    visible = [2 in ids(view) for view in seen]
    assert visible == sorted(visible, reverse=True)
    assert visible.count(True) <= 4  # its last frame, and three periods
    driving = [view.fault == "" for view in seen]
    assert driving == sorted(driving, reverse=True)
    assert driving.count(True) == pytest.approx(1.0 / PERIOD_S, abs=2)
    assert seen[-1].fault == "robot 2 was not heard for 1 s"
    assert world.teams[0].report().masked == {2: visible.count(False)}


def test_a_blackout_stops_the_team_and_its_end_lets_it_go_on():
    world = World(3)
    world.ticks(5)
    world.network.loss = 1.0
    dark = world.ticks(150)
    assert {view.fault for view in dark[-1].values()} == {"no teammate was heard for 0.2 s"}
    assert all(view.teammates == () for view in dark[-1].values())
    world.network.loss = 0.0
    *_, after = world.ticks(3)
    assert all(view.fault == "" and len(view.teammates) == 2 for view in after.values())


def test_a_pair_stops_soon_after_one_of_it_dies():
    world = World(2)
    world.ticks(5)
    world.network.dead.add(1)
    seen = [views[0].fault for views in world.ticks(20)]
    assert seen.index("no teammate was heard for 0.2 s") <= 0.2 / PERIOD_S + 2


def test_a_fifth_of_the_packets_may_be_lost():
    world = World(4, Network(loss=0.2, seed=3))
    world.ticks(20)
    seen = [view for views in world.ticks(1000) for view in views.values()]
    assert all(view.fault == "" for view in seen)
    ages = sorted(mate.age_s for view in seen for mate in view.teammates)
    assert ages[int(0.99 * len(ages))] <= 2 * PERIOD_S + 1e-6
    report = world.teams[0].report()
    assert report.used_age_ms.p99 <= 2e3 * PERIOD_S + 1e-3
    assert report.message_age_ms.max <= 1e-3  # what is lost makes no message old
    assert report.accepted == pytest.approx(0.8 * report.sent, rel=0.05)


def test_a_restarted_robot_is_heard_again_whatever_its_clock_says():
    world = World(3)
    world.ticks(5)
    world.offset_s[2] -= 3600.0
    world.network.queues[2].clear()
    world.teams[2] = world.make(2, nonces=itertools.count(77))
    *_, last = world.ticks(30)
    assert [ids(view) for view in last.values()] == [[1, 2], [0, 2], [0, 1]]
    assert all(mate.age_s <= 2 * PERIOD_S for view in last.values() for mate in view.teammates)


def test_a_recorded_run_is_refused_after_a_restart():
    world = World(2)
    world.ticks(50)
    recorded = [packet for sender, receiver, packet in world.network.recorded if (sender, receiver) == (1, 0)]
    world.network.dead.add(1)
    world.teams[0] = world.make(0, nonces=itertools.count(77))
    view = None
    for packet in recorded:
        world.network.queues[0].append(packet)
        view = world.tick()[0]
    assert view.teammates == ()
    assert view.fault == "waits for robots 1: not heard yet"
    assert world.teams[0].report().refused == {"unanswered": len(recorded)}


def test_recordings_do_not_keep_a_true_peer_out():
    world = World(2)
    world.ticks(50)
    recorded = [packet for sender, receiver, packet in world.network.recorded if (sender, receiver) == (1, 0)]
    world.teams = {0: world.make(0, nonces=itertools.count(77)), 1: world.make(1, nonces=itertools.count(99))}
    for _ in range(10):
        world.network.queues[0].extendleft(recorded)
        views = world.tick()
    assert ids(views[0]) == [1] and ids(views[1]) == [0]


def test_frames_for_others_and_of_other_teams_are_refused():
    world = World(3)
    world.ticks(5)
    before = world.teams[0].report()
    stray = [packet for sender, receiver, packet in world.network.recorded if (sender, receiver) == (1, 2)]
    own = [packet for sender, receiver, packet in world.network.recorded if sender == 0]
    foreigner = World(3)
    foreigner.teams[1] = foreigner.make(1, key=b"x" * 32)
    foreigner.ticks(5)
    foreign = [
        packet for sender, receiver, packet in foreigner.network.recorded if (sender, receiver) == (1, 0)
    ]
    world.network.queues[0].clear()
    world.network.queues[0].extend([*stray, *own, *foreign, b"", b"CFP\x03", foreign[0] + b"x"])
    world.view(0)
    after = world.teams[0].report()
    assert after.accepted == before.accepted
    assert after.refused["misdirected"] == len(stray) + len(own)
    assert after.refused["foreign"] == len(foreign)
    assert after.refused["malformed"] == 3


@pytest.mark.parametrize("rules", [{"dims": 3}, {"action_dim": 3}])
def test_a_robot_with_another_body_is_kept_out_and_named(rules):
    world = World(2)
    world.teams[0] = world.make(0)
    world.teams[0]._body = rules.get("dims", 2), rules.get("action_dim", 2)
    *_, views = world.ticks(5)
    assert views[0].teammates == ()
    assert views[0].fault == (
        "waits for robots 1: not heard yet; robot 1 is kept out: it moves or acts in other dimensions"
    )
    assert views[0].own and world.teams[0].report().doubted[1] > 0


def test_late_and_repeated_frames_are_counted_apart():
    world = World(2)
    world.ticks(100)
    world.network.queues[0].clear()
    base = world.teams[0].report()
    recorded = [packet for sender, receiver, packet in world.network.recorded if (sender, receiver) == (1, 0)]
    older, newest = recorded[-2:]
    world.network.queues[0].extend([newest, newest, recorded[-3], recorded[-3], recorded[10]])
    world.view(0)
    refused = world.teams[0].report().refused
    assert older != newest
    assert world.teams[0].report().accepted == base.accepted + 1
    assert refused["duplicate"] - base.refused.get("duplicate", 0) == 3
    assert refused["replayed"] == 1


def test_listening_to_the_nearest_as_they_move():
    world = World(8, nearest=2)
    *_, last = world.ticks(30)
    assert ids(last[0]) == [1, 2]
    assert ids(last[7]) == [5, 6]
    assert set(map(tuple, map(ids, (last[3],)))) <= {(2, 4)}
    world.position[0] = (7.5, 0.0)  # it drives to the other end
    *_, last = world.ticks(30)
    assert ids(last[0]) == [6, 7]
    assert ids(last[1]) == [2, 3]
    assert all(view.fault == "" for view in last.values())
    assert all(mate.age_s <= 2 * PERIOD_S for view in last.values() for mate in view.teammates)


def test_listening_to_the_nearest_costs_less_than_to_all():
    all_of_them, nearest = World(16), World(16, nearest=2)
    for world in (all_of_them, nearest):
        world.ticks(20)
    before = {robot_id: team.report().sent for robot_id, team in nearest.teams.items()}
    nearest.ticks(100)
    sent = [nearest.teams[robot_id].report().sent - before[robot_id] for robot_id in before]
    assert max(sent) <= 100 * 6  # two it listens to, at most three that listen to it, one in turn


def test_a_dead_robot_leaves_its_place_to_the_next_nearest():
    world = World(5, nearest=2, missing_s=1e9)
    world.ticks(30)
    world.network.dead.add(1)
    *_, last = world.ticks(30)
    assert ids(last[0]) == [2, 3]


def test_fixed_neighbours_need_not_be_mutual():
    world = World(3, neighbours={0: (2,), 1: (0,), 2: ()})
    *_, last = world.ticks(8)
    assert [ids(view) for view in last.values()] == [[2], [0], []]
    assert all(view.fault == "" for view in last.values())


def test_the_objectives_version_rides_in_every_frame():
    world = World(3)
    orders = world.teams[2]._orders
    orders.guide = replace(orders.guide, version=7)
    world.ticks(5)
    assert world.teams[0].report().objectives_version == {1: 0, 2: 7}


def tick_far_ahead(team, _number):
    team._tick.number = 2**53


def tick_that_leaps(team, _number):
    team._tick.number += 2**32


def sequence_at_its_end(team, _number):
    team._sequence = 2**64 - 2


def boot_after_boot(team, number):
    team._boot_id = 10**6 + number


LIES = [
    (tick_far_ahead, "its tick of the team leaps"),
    (tick_that_leaps, "its tick of the team leaps"),
    (sequence_at_its_end, "its sequence leaps"),
    (boot_after_boot, "it restarts again and again"),
]


@pytest.mark.parametrize("lie, named", LIES)
@pytest.mark.parametrize("once", [False, True])
def test_a_member_that_lies_costs_the_others_nothing(lie, named, once):
    """With the right key; once, as a bit that flips in its memory does, or with every frame from then on."""
    world = World(4, missing_s=1.0)
    world.ticks(30)
    liar, seen = world.teams[3], []
    true = liar._tick.number, liar._sequence, liar._boot_id
    for number in range(150):
        if not (once and number):
            lie(liar, number)
        seen.append(world.tick())
        if once and number == 0:
            liar._tick.number, liar._sequence, liar._boot_id = true
    views = [views[robot] for views in seen for robot in range(3)]
    assert all({0, 1, 2} <= {view.own.robot_id, *ids(view)} for view in views)
    report = world.teams[0].report()
    assert set(report.doubted) <= {3}
    ticks = [world.teams[robot].tick for robot in range(3)]
    assert max(ticks) - min(ticks) <= 1
    if once:
        assert all(view.fault == "" for view in views)
    else:
        assert report.doubted[3] > 50
        assert seen[-1][0].fault in ("", f"robot 3 was not heard for 1 s; robot 3 is kept out: {named}")


def test_a_member_that_lied_from_the_start_is_named():
    world = World(3)
    for _ in range(30):
        sequence_at_its_end(world.teams[2], 0)
        views = world.tick()
    assert views[0].fault == "waits for robots 2: not heard yet; robot 2 is kept out: its sequence leaps"
    assert ids(views[0]) == [1]


def test_a_state_that_is_not_finite_is_refused_and_its_robot_masked():
    world = World(2)
    world.ticks(5)
    world.position[1] = (float("nan"), 0.0)
    *_, last = world.ticks(8)
    assert last[0].teammates == ()
    assert world.teams[0].report().refused["not finite"] > 0


def test_a_state_that_grows_stale_at_its_source_is_masked_though_frames_arrive():
    world = World(2)
    world.ticks(5)
    frozen = world.own(1)
    for _ in range(8):
        views = {0: world.view(0), 1: world.view(1)}
        world.teams[1].share(frozen, Command(1, 0, 0.0, (0.0, 0.0), (0.0, 0.0)))
        world.now_s += PERIOD_S
    assert views[0].teammates == ()


def test_a_flood_costs_a_bounded_part_of_the_tick():
    world = World(2)
    world.ticks(5)
    queue = world.network.queues[0]
    queue.extend([b"junk"] * 1000)
    own, world.offset_s = world.own(0), MovedByLooks(world.offset_s)
    world.teams[0].team(world.teams[0].locate(own))
    assert 1000 - len(queue) == pytest.approx(0.1 * PERIOD_S / MovedByLooks.STEP_S + 4, abs=3)


class MovedByLooks(dict):
    """Offsets of clocks that go on by 0.1 ms whenever they are read."""

    STEP_S, looks = 1e-4, 0

    def __getitem__(self, robot_id):
        self.looks += 1
        return super().__getitem__(robot_id) + self.STEP_S * self.looks


def test_leaving_closes_the_carrier():
    world = World(2)
    with world.teams[0] as team:
        carrier = team._carrier
    assert carrier.closed
    assert len(KEY) == 32
