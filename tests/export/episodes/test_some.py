"""Deciding for some of many robots: each by its own kind, and only as long as its episode lasts."""

from types import SimpleNamespace

import numpy as np

from export.episodes.some import by_kind, while_running
from export.evaluation.outlook import MotionBatch, TeamBatch

TEAMS, ROBOTS = 6, 3
ROWS = TEAMS * ROBOTS


def some_views():
    draw = np.random.default_rng(1)
    position, velocity, action = draw.normal(size=(3, TEAMS, ROBOTS, 2))
    views = TeamBatch.of_teams(position, velocity, action)
    there = MotionBatch.of(*draw.normal(size=(2, ROWS, 2)))
    seen = draw.normal(size=(ROWS, 4)).astype(np.float32)
    return seen, TeamBatch(**{**vars(views), "tracked": {"box": there}})


def plainly(seen, views, _draw):
    """What depends on all that a robot knows."""
    own = views.own.position_m + views.robot_id[:, None] + views.tracked["box"].velocity_m_s
    mates = (views.mates.position_m * views.mate_action + views.mate_id[..., None]).sum(1)
    return own + mates + seen[:, :2]


def deciding(made, factor=1.0):
    def prepare(batch):
        made.append(batch)

        def decide(seen, views, draw):
            assert len(seen) == batch
            return factor * plainly(seen, views, draw)

        return decide

    return prepare


def test_each_kind_of_robot_decides_in_its_own_way():
    seen, views = some_views()
    made = []
    decide = by_kind([deciding(made), deciding(made, -2.0)], [1, 0, 1])(ROWS)
    expected = plainly(seen, views, None).reshape(TEAMS, ROBOTS, 2) * np.array([[[-2.0], [1.0], [-2.0]]])
    np.testing.assert_array_equal(decide(seen, views, None), expected.reshape(ROWS, 2))
    assert made == [TEAMS, 2 * TEAMS]


def test_robots_of_episodes_that_go_on_decide_as_if_all_did():
    seen, views = some_views()
    whole, made = plainly(seen, views, None).reshape(TEAMS, ROBOTS, 2), []
    judge = SimpleNamespace(running=np.ones(TEAMS, bool))
    decide = while_running(deciding(made), judge)(ROWS)
    for over, decided in [([], 6), ([4], 6), ([0, 3], 3), ([1], 3), ([2], 1), ([5], 1)]:
        judge.running[over] = False
        action = decide(seen, views, None).reshape(TEAMS, ROBOTS, 2)
        np.testing.assert_array_equal(action[judge.running], whole[judge.running])
        assert np.count_nonzero(action.any((1, 2))) == decided
    assert made == [ROWS, 3 * ROBOTS, ROBOTS]
