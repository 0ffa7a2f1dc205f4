"""A signed policy handed to a running team: four real edge-run, all of which run it, or none does."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
from contextlib import ExitStack

import pytest
from bundles import MANIFEST, write_straight_bundle
from fleet_processes import robot
from msgspec.structs import replace
from waiting import HANG_S, until

from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.signature import SIGNATURE_FILE, sign
from edge_runtime.recording.reader import read_log
from edge_runtime.recording.schema import Tick
from edge_runtime.team.link import REST_M_S
from edge_runtime.team.orders import HANDOVER
from edge_runtime.tools.ctl import edge_ctl as ctl
from edge_runtime.tools.replay import edge_replay

nacl = pytest.importorskip("nacl.bindings")
SEED = bytes(range(32))
ROBOTS = 4
RUNNING = "straight"


def public(seed):
    return nacl.crypto_sign_seed_keypair(seed)[0].hex()


def bundle(folder, name, version=None, seed=SEED, **changes):
    directory = write_straight_bundle(folder / name, replace(MANIFEST, name=name, **changes))
    if version is not None:
        sign(directory, load_bundle(directory).sha256, version, seed)
    return directory


class Team:
    """Four robots of which a test knows what each process writes."""

    def __init__(self, folder, stack):
        self.folder, self.path = folder, folder / "team.toml"
        (folder / "team.key").write_bytes(bytes(range(1, 33)))
        (folder / "team.key").chmod(0o600)
        bundle(folder, RUNNING, 1)
        keys = f'trusted_keys = ["{public(SEED)}"]\npolicy = "./{RUNNING}"'
        robots = "".join(robot(robot_id) for robot_id in range(ROBOTS)).replace(
            "goal_m = [1,", "goal_m = [90,"
        )
        self.path.write_text(f'[team]\n{keys}\n[carrier]\nkey = "team.key"\n{robots}')
        self.processes = [stack.enter_context(self.process(robot_id)) for robot_id in range(ROBOTS)]
        stack.callback(self.kill)

    def kill(self):
        for process in self.processes:
            process.kill()

    def process(self, robot_id):
        flags = ["--fleet", self.path, "--robot-id", robot_id, "--stay", "--duration", "9999", "--rate", "20"]
        flags += ["--json", self.folder / f"{robot_id}.json", "--log-dir", self.folder / f"log{robot_id}"]
        state = {"XDG_STATE_HOME": str(self.folder / "state")}
        return subprocess.Popen(
            [sys.executable, "-m", "edge_runtime.run", *map(str, flags)],
            env={**os.environ, **state},
            stdout=subprocess.DEVNULL,
        )

    def order(self, *words):
        return ctl.main([*map(str, words), "--timeout", "8", "--fleet", str(self.path)])

    def rows(self, capsys):
        capsys.readouterr()
        code = self.order("status")
        return code, [re.split(r"  +", row.strip()) for row in capsys.readouterr().out.splitlines()[1:]]

    def until_all_drive(self, capsys):
        def driving():
            code, rows = self.rows(capsys)
            return code == 0 and len(rows) == ROBOTS and all(row[-1] == "yes" for row in rows)

        until(driving, pause_s=0.2)

    def stop(self, capsys):
        assert self.order("stop") == 0
        for process in self.processes:
            assert process.wait(HANG_S) == 0
        capsys.readouterr()
        return [json.loads((self.folder / f"{robot_id}.json").read_text()) for robot_id in range(ROBOTS)]


@pytest.fixture
def team(tmp_path):
    with ExitStack() as stack:
        yield Team(tmp_path, stack)


def policies(rows):
    return [row[1].split()[0] for row in rows]


def test_four_robots_run_a_policy_from_one_tick_on(team, tmp_path, capsys):
    team.until_all_drive(capsys)
    after = bundle(tmp_path, "newer", 2, euler_steps=5)
    until(lambda: team.order("policy", after) == 0)  # on a busy machine a robot may be too slow at first
    told = r"4 robots run newer [0-9a-f]{12} from tick (\d+) on, as the team's version (\d+)\n"
    tick, version = map(int, re.fullmatch(told, capsys.readouterr().out).groups())
    team.until_all_drive(capsys)
    code, rows = team.rows(capsys)
    assert (code, policies(rows)) == (0, ["newer"] * ROBOTS)
    assert all(int(row[4]) >= tick for row in rows)
    for report in team.stop(capsys):
        assert (report["policy"], report["failed"]) == ("newer", False)
        assert any("policy is handed over" in fault for fault in report["faults"])
        assert report["fleet"]["own_objectives_version"] == version
    for robot_id in range(ROBOTS):
        ledger = tmp_path / "state" / "cfpg-edge" / "policies" / f"robot{robot_id}.json"
        assert json.loads(ledger.read_text()) == {RUNNING: 1, "newer": 2}
        (log,) = (tmp_path / f"log{robot_id}").glob("*.mcap")
        assert edge_replay.main([str(log)]) == 0, capsys.readouterr()
        ticks = [record for record in read_log(log) if isinstance(record, Tick)]
        first = next(index for index, tick in enumerate(ticks) if tick.inputs.objectives_version)
        assert ticks[first - 1].command.stop_reason == HANDOVER
        assert math.hypot(*ticks[first].state.own.velocity_m_s) <= REST_M_S
        assert ticks[first].command.sequence == ticks[first - 1].command.sequence + 1


def test_one_refusal_and_nobody_changes(team, tmp_path, capsys):
    """Robot 2 has run a newer one already."""
    team.until_all_drive(capsys)
    ledger = tmp_path / "state" / "cfpg-edge" / "policies" / "robot2.json"
    ledger.write_text(json.dumps({RUNNING: 1, "newer": 5}))
    after = bundle(tmp_path, "newer", 2)
    refusal = "edge-ctl: nothing was changed: robot 2 refuses: version 2 of policy 'newer' is older"

    def refused():
        assert team.order("policy", after) == 1
        complaint = capsys.readouterr().err
        assert complaint.count("\n") == 1
        return complaint.startswith(refusal)

    until(refused)  # on a busy machine another robot may be too slow at first
    team.until_all_drive(capsys)
    assert policies(team.rows(capsys)[1]) == [RUNNING] * ROBOTS
    for report in team.stop(capsys):
        assert report["policy"] == RUNNING


@pytest.mark.parametrize(("harm", "said"), [
    ("unsigned", "is not signed"),
    ("other key", "which is none of [team]'s trusted_keys"),
    ("changed", "is not what was signed"),
])  # fmt: skip
def test_what_the_operator_may_not_send_is_refused_here(tmp_path, capsys, harm, said):
    """Before anything is sent."""
    (tmp_path / "team.key").write_bytes(bytes(range(1, 33)))
    (tmp_path / "team.key").chmod(0o600)
    path = tmp_path / "team.toml"
    path.write_text(f'[team]\ntrusted_keys = ["{public(SEED)}"]\n[carrier]\nkey = "team.key"\n{robot(0)}')
    after = bundle(
        tmp_path, "newer", None if harm == "unsigned" else 2, SEED[::-1] if harm == "other key" else SEED
    )
    if harm == "changed":
        other = bundle(tmp_path, "other", 2)
        shutil.copy(other / SIGNATURE_FILE, after)
    assert ctl.main(["policy", str(after), "--fleet", str(path)]) == 2
    assert said in capsys.readouterr().err
