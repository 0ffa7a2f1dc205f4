"""Fleet and objectives files: what fits, and the one line that says what does not."""

import pytest

from edge_runtime.common.signals import StopSignals
from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.config.network import CarrierSettings
from edge_runtime.config.objectives import load_objective_set
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.objectives import SafetyMargin, SpeedLimit

ROBOT_KEYS = (
    "id, start_m, goal_m, start_heading_rad, address, neighbours, policy, mass_kg, drag, slew_per_s, "
    "max_action, max_speed_m_s, pose, ranges, sensors, rigid_body, zenoh"
)
ROBOTS = "[[robots]]\nid = 3\nstart_m = [0, 0]\ngoal_m = [1, 0.5]\n"
OWN = """
from edge_runtime.objectives import Objective, Slope

class KeepLeft(Objective, frozen=True, kw_only=True):
    border_m: float

    def evaluate(self, motion, outlook):
        return Slope(0.0)

class Else: ...
"""


@pytest.fixture
def write(tmp_path):
    def write_file(text):
        path = tmp_path / "file.toml"
        path.write_text(text)
        return path

    return write_file


def complaint(load, path):
    """The one line of the error, without the file that it must name first."""
    with pytest.raises(ConfigError) as caught:
        load(path)
    file, _, rest = str(caught.value).partition(": ")
    assert file == str(path)
    assert "\n" not in rest
    return rest


def test_the_built_in_fleet():
    fleet = load_fleet(DEFAULT_FLEET)
    assert [robot.id for robot in fleet.robots] == [0, 1, 2, 3]
    assert fleet.team.policy == "navigation"
    assert fleet.objective_set.objectives == (SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25))


def test_a_fleet_of_defaults(write):
    fleet = load_fleet(write(ROBOTS))
    assert fleet.robot(3).goal_m == (1.0, 0.5)
    assert fleet.team.rate_hz is None
    assert fleet.objective_set.objectives == ()
    assert fleet.objective_set.guidance == GuidanceSettings()


def test_objectives_with_guidance(write):
    objective = '[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 1\nweight = 2\n'
    asked = load_objective_set(write(objective + '[guidance]\nmode = "none"\nscale = 3'))
    assert asked.objectives == (SpeedLimit(limit_m_s=1.0, weight=2.0),)
    assert asked.guidance == GuidanceSettings(mode="none", scale=3.0)


def test_an_own_objective_beside_its_file(write, tmp_path):
    (tmp_path / "my_rules.py").write_text(OWN)
    path = write('[[objectives]]\ntype = "my_rules:KeepLeft"\nborder_m = 0.5')
    (objective,) = load_objective_set(path).objectives
    assert (type(objective).__name__, objective.border_m) == ("KeepLeft", 0.5)
    path = write('[[objectives]]\ntype = "my_rules:Else"')
    assert complaint(load_objective_set, path) == (
        "objectives[0].type: 'my_rules:Else' is not a subclass of edge_runtime.objectives.Objective"
    )
    path = write('[[objectives]]\ntype = "my_rules:KeepRight"')
    assert complaint(load_objective_set, path).startswith(
        "objectives[0].type: cannot import 'my_rules:KeepRight' ("
    )


OWN_MISTAKES = {
    "Wrong": ("1 / 0", "ZeroDivisionError: division by zero"),
    "Leaves": ("raise SystemExit(3)", "SystemExit: 3"),
    "Lacks": ("raise KeyError('line')", "KeyError: 'line'"),
}


def own_objective(name, body):
    return f"from edge_runtime.objectives import Objective\nclass {name}(Objective, frozen=True):\n{body}" + (
        "\n    def evaluate(self, motion, outlook): return 0.0, 0.0, 0.0, 0.0, 0.0\n"
    )


@pytest.mark.parametrize(
    ("name", "body", "said"),
    [
        *(
            (name, f"    def __post_init__(self): {code}", f"'mine_{name}:{name}' cannot be made ({cause})")
            for name, (code, cause) in OWN_MISTAKES.items()
        ),
        ("Foreign", "    line: 'Foo' = 1", "'mine_Foreign:Foreign' cannot be made (NameError: name 'Foo' is"),
        ("Five", "    line: 5 = 1", "'mine_Five:Five' cannot be made (TypeError: Type '5' is not supported)"),
        ("Numbered", "    name = 5", "the name of 'mine_Numbered:Numbered' must be a string, got 5"),
        ("Nameless", "    name: object = None", "the name of 'mine_Nameless:Nameless' must be a string, got"),
        (
            "Unnamed",
            "    @property\n    def name(self): return 1 / 0",
            "'mine_Unnamed:Unnamed' cannot be made",
        ),
        ("Opaque", "    line: object = ...", "'mine_Opaque:Opaque' cannot be made (TypeError: "),
    ],
)
def test_an_own_objective_that_cannot_be_made_is_one_line_with_its_name(write, tmp_path, name, body, said):
    (tmp_path / f"mine_{name}.py").write_text(own_objective(name, body))
    told = complaint(load_objective_set, write(f"[[objectives]]\ntype = 'mine_{name}:{name}'"))
    assert told.startswith(f"objectives[0]: {said}")


@pytest.mark.parametrize("leaving", ["raise SystemExit(0)", "raise KeyboardInterrupt", "raise GeneratorExit"])
def test_a_module_that_leaves_while_it_is_imported_is_one_line(write, tmp_path, leaving):
    module = f"leaves_{leaving[6:12].lower()}"
    (tmp_path / f"{module}.py").write_text(leaving)
    with StopSignals():
        told = complaint(load_objective_set, write(f"[[objectives]]\ntype = '{module}:X'"))
    assert told.startswith(f"objectives[0].type: cannot import '{module}:X' ({leaving[6:12]}")


def test_ctrl_c_while_a_module_is_imported_is_no_fault_of_the_module(write, tmp_path):
    (tmp_path / "slow_one.py").write_text("raise KeyboardInterrupt")
    with pytest.raises(KeyboardInterrupt):
        load_objective_set(write("[[objectives]]\ntype = 'slow_one:X'"))


@pytest.mark.parametrize(
    "text, expected",
    [
        ("robots = []", "robots: a fleet needs at least one robot"),
        (
            "",
            "robots: missing; allowed: robots, team, objectives, guidance, carrier, watch, obstacle, "
            "tracked, belief, simulation",
        ),
        (ROBOTS * 2, "robots[1].id: 3 is taken by robots[0]"),
        (ROBOTS.replace("3", "-3"), "robots[0]: `id` must lie in [0, 65535], got -3"),
        (ROBOTS.replace("3", "true"), "robots[0].id: Expected `int`, got `bool`"),
        (ROBOTS.replace("0.5", "nan"), "robots[0].goal_m[1]: must be a finite number, got nan"),
        (ROBOTS.replace("0.5", "-inf"), "robots[0].goal_m[1]: must be a finite number, got -inf"),
        (ROBOTS.replace("0.5", "1e999"), "robots[0].goal_m[1]: must be a finite number, got inf"),
        (ROBOTS.replace("0.5", "'x'"), "robots[0].goal_m[1]: Expected `float`, got `str`"),
        (ROBOTS.replace(", 0.5", ""), "robots[0].goal_m: Expected `array` of length >= 2"),
        (
            ROBOTS + "gaol = 1",
            f"robots[0].gaol: unknown key; allowed: {ROBOT_KEYS}",
        ),
        (
            ROBOTS.replace("id = 3", ""),
            f"robots[0].id: missing; allowed: {ROBOT_KEYS}",
        ),
        (ROBOTS + "[team]\nrate_hz = 'fast'", "team.rate_hz: Expected `float | null`, got `str`"),
        (ROBOTS + "[team]\nrate_hz = 0", "team: `rate_hz` must lie in [1, 1000], got 0"),
        (
            ROBOTS + "[team]\ngoal_tolerance_m = 0",
            "team: `goal_tolerance_m` must lie in [1e-06, 1e+06], got 0",
        ),
        (ROBOTS + "[team]\nmax_state_age_s = nan", "team.max_state_age_s: must be a finite number, got nan"),
        (ROBOTS.replace("0.5", "1e39"), "robots[0]: `goal_m` must lie in [-1e+06, 1e+06], got 1e+39"),
        (
            ROBOTS + "[team]\nmax_state_age_s = 0.2",
            "team: `max_state_age_s` must lie in [0.001, 0.1], got 0.2",
        ),
        (ROBOTS + "[team]\nslew_per_s = 1e300", "team: `slew_per_s` must lie in [1e-06, 1e+06], got 1e+300"),
        (
            ROBOTS + "[guidance]\nstart_noise = 1e300",
            "guidance: `start_noise` must lie in [0, 1e+06], got 1e+300",
        ),
        (ROBOTS + "[guidance]\nreach = -1", "guidance: `reach` must be finite and not negative, got -1.0"),
        (ROBOTS + "drag = 1.0", "robots[0]: `drag` must lie in [0, 1), got 1"),
        (ROBOTS + "mass_kg = 0", "robots[0]: `mass_kg` must lie in [1e-06, 1e+06], got 0"),
        (
            ROBOTS + "pose = 'lidar'",
            "robots[0]: `pose` must be \"bridge\" or a stream's address, such as 10.0.0.5:47100, got 'lidar'",
        ),
        (
            ROBOTS + "ranges = '1.2.3.4'",
            'robots[0]: `ranges` must be "teammates" or a stream\'s address, such as '
            "10.0.0.5:47100, got '1.2.3.4'",
        ),
        (
            ROBOTS + "pose = '1.2.3.4:5'",
            'robots[0].pose: means nothing without [carrier]; add [carrier] key = "team.key"',
        ),
        (
            ROBOTS + "policy = './x'",
            'robots[0].policy: means nothing without [carrier]; add [carrier] key = "team.key"',
        ),
        (ROBOTS + "[[team]]", "team: Expected `table`, got `array`"),
        (
            ROBOTS + '[watch]\naddress = "127.0.0.1:47900"',
            'watch: means nothing without [carrier]; add [carrier] key = "team.key"',
        ),
        (
            ROBOTS + "[teem]",
            "teem: unknown key; allowed: robots, team, objectives, guidance, carrier, watch, obstacle, "
            "tracked, belief, simulation",
        ),
        (
            ROBOTS + "[[obstacle]]\ncentre_m = [0, 0]",
            "obstacle[0].radius_m: missing; allowed: centre_m, radius_m, velocity_m_s",
        ),
        (
            ROBOTS + "[[obstacle]]\ncentre_m = [0, 0]\nradius_m = 0",
            "obstacle[0]: `radius_m` must lie in [1e-06, 1e+06], got 0",
        ),
        (ROBOTS + "[guidance]\nscale = inf", "guidance.scale: must be a finite number, got inf"),
    ],
)
def test_fleets_that_do_not_hold_together(write, text, expected):
    assert complaint(load_fleet, write(text)) == expected


TEAM = """
[carrier]
key = "team.key"
[[robots]]
id = 1
start_m = [0, 0]
goal_m = [1, 0]
address = "127.0.0.1:47001"
[[robots]]
id = 2
start_m = [0, 1]
goal_m = [1, 1]
address = "127.0.0.1:47002"
neighbours = [1]
"""


def test_a_team_of_processes(write):
    fleet = load_fleet(write(TEAM))
    assert fleet.carrier == CarrierSettings(
        key="team.key", type="udp", nearest=None, alone_s=1.0, missing_s=30.0
    )
    assert [robot.neighbours for robot in fleet.robots] == [None, (1,)]
    assert load_fleet(write(TEAM.replace("127.0.0.1", "[::1]"))).robot(1).address == "[::1]:47001"
    assert load_fleet(write(ROBOTS)).carrier is None


ADDRESS = "`address` must be one machine's IP and port, such as 10.0.0.12:47000, got "


@pytest.mark.parametrize(
    "old, new, expected",
    [
        ("47002", "47001", "robots[1].address: 127.0.0.1:47001 is taken by robots[0]"),
        ("127.0.0.1:47002", "[::1]:47002", "robots[1].address: IPv4 and IPv6 do not mix in one team"),
        (
            'address = "127.0.0.1:47002"',
            "",
            "robots[1].address: missing; with [carrier] every robot needs one",
        ),
        ("127.0.0.1:47001", "0.0.0.0:47001", f"robots[0]: {ADDRESS}'0.0.0.0:47001'"),
        ("127.0.0.1:47001", "224.0.0.1:47001", f"robots[0]: {ADDRESS}'224.0.0.1:47001'"),
        ("127.0.0.1:47001", "robot-1:47001", f"robots[0]: {ADDRESS}'robot-1:47001'"),
        ("127.0.0.1:47001", "127.0.0.1", f"robots[0]: {ADDRESS}'127.0.0.1'"),
        ("127.0.0.1:47001", "::1:47001", f"robots[0]: {ADDRESS}'::1:47001'"),
        ("127.0.0.1:47001", "[127.0.0.1]:47001", f"robots[0]: {ADDRESS}'[127.0.0.1]:47001'"),
        ("47001", "0", f"robots[0]: {ADDRESS}'127.0.0.1:0'"),
        ("47001", "65536", f"robots[0]: {ADDRESS}'127.0.0.1:65536'"),
        ("47001", "+1", f"robots[0]: {ADDRESS}'127.0.0.1:+1'"),
        ("[1]", "[7]", "robots[1].neighbours: no other robot has id 7; others: 1"),
        ("[1]", "[2]", "robots[1].neighbours: no other robot has id 2; others: 1"),
        ("[1]", "[1, 1]", "robots[1]: `neighbours` names a robot twice: [1, 1]"),
        ("[1]", "['1']", "robots[1].neighbours[0]: Expected `int`, got `str`"),
        ("id = 2", "id = 1", "robots[1].id: 1 is taken by robots[0]"),
        (
            'key = "team.key"',
            "",
            "carrier.key: missing; allowed: key, type, operator_key, nearest, alone_s, missing_s, router, ",
        ),
        ('"team.key"', '""', "carrier: `key` must name the file of a key, such as "),
        ("[carrier]", '[carrier]\noperator_key = ""', "carrier: `operator_key` must name the file of a key"),
        ("[carrier]", "[carrier]\nkee = 1", "carrier.kee: unknown key; allowed: key, type, operator_key, "),
        (
            "[carrier]",
            "[carrier]\ntype = 'tcp'",
            "carrier.type: Invalid enum value 'tcp'; allowed: 'udp', 'zenoh'",
        ),
        ("[carrier]", "[carrier]\nnearest = 0", "carrier: `nearest` must be at least 1, got 0"),
        ("[carrier]", "[carrier]\nalone_s = 0", "carrier: `alone_s` must lie in [0.001, 86400], got 0"),
        ("[carrier]", "[carrier]\nmissing_s = inf", "carrier.missing_s: must be a finite number, got inf"),
        (
            '[carrier]\nkey = "team.key"',
            "",
            "robots[0].address: means nothing without [carrier]; add [carrier] ",
        ),
        (
            "[carrier]",
            '[watch]\naddress = "127.0.0.1:47001"\n[carrier]',
            "watch.address: 127.0.0.1:47001 is taken by robots[0]",
        ),
        ("[carrier]", '[watch]\naddress = "all"\n[carrier]', f"watch: {ADDRESS}'all'"),
        ("[carrier]", "[watch]\n[carrier]", "watch.address: missing; allowed: address"),
        (
            "[carrier]",
            "[[obstacle]]\ncentre_m = [5, 5]\nradius_m = 1\n[carrier]",
            "obstacle: means nothing with [carrier]: only a team simulated in one process has any",
        ),
    ],
)
def test_teams_that_do_not_hold_together(write, old, new, expected):
    assert old in TEAM
    assert complaint(load_fleet, write(TEAM.replace(old, new))).startswith(expected)


@pytest.mark.parametrize(
    "text, expected",
    [
        ("objectives = 3", "objectives: Expected `array`, got `int`"),
        ("[guidance]\nmode = 'nice'", "guidance.mode: Invalid enum value 'nice'; allowed: 'none', "),
        ("[guidance]\nscale = -1", "guidance: `scale` must be finite and not negative, got -1.0"),
        (
            "[[objectives]]\nlimit_m_s = 1",
            "objectives[0].type: missing; allowed: speed_limit, safety_margin, ",
        ),
        ("[[objectives]]\ntype = 3", "objectives[0].type: must be a string, got 3; allowed: speed_limit, "),
        (
            "[[objectives]]\ntype = 'fence'",
            "objectives[0].type: unknown objective 'fence'; allowed: speed_limit, ",
        ),
        (
            "[[objectives]]\ntype = 'no_such:X'",
            "objectives[0].type: cannot import 'no_such:X' (ModuleNotFoundError: No module named",
        ),
        (
            "[[objectives]]\ntype = 'speed_limit'",
            "objectives[0].limit_m_s: missing; allowed: weight, look_ahead, ",
        ),
        (
            "[[objectives]]\ntype = 'speed_limit'\nlimit_m_s = 1\nlimit = 2",
            "objectives[0].limit: unknown key; allowed: weight, look_ahead, limit_m_s, buffer_m_s",
        ),
        (
            "[[objectives]]\ntype = 'speed_limit'\nlimit_m_s = 0.3\n[[objectives]]\ntype = 'safety_margin'\n"
            "distance_m = '1'",
            "objectives[1].distance_m: Expected `float`, got `str`",
        ),
        (
            "[[objectives]]\ntype = 'safety_margin'\ndistance_m = -1",
            "objectives[0]: `distance_m` must be positive, got -1",
        ),
        ("[[robots]]\nid = 3", "robots: unknown key; allowed: objectives, guidance"),
        ("", "objectives: missing; a file for none says `objectives = []`"),
        ("# limit_m_s = 0.2\n", "objectives: missing"),
        ("a = [", "is not TOML ("),
        ("a = 1\na = 2", "is not TOML ("),
        (
            '[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 1\nweight = 1e308',
            "objectives[0]: `weight` must lie in [-1e+06, 1e+06], got 1e+308",
        ),
    ],
)
def test_objectives_that_do_not_hold_together(write, text, expected):
    assert complaint(load_objective_set, write(text)).startswith(expected)


def test_a_file_may_ask_for_nothing_if_it_says_so(write):
    assert load_objective_set(write("objectives = []")).objectives == ()
    assert load_objective_set(write('[guidance]\nmode = "none"')).objectives == ()


def test_files_that_cannot_be_read(tmp_path):
    assert complaint(load_fleet, tmp_path / "none.toml") == "cannot be read (No such file or directory)"
    assert complaint(load_fleet, tmp_path) == "cannot be read (Is a directory)"
    (tmp_path / "binary.toml").write_bytes(b"\xff\xff")
    assert complaint(load_fleet, tmp_path / "binary.toml").startswith("is not TOML (")


def test_more_robots_and_objectives_than_any_team_has(write):
    robots = "".join(ROBOTS.replace("id = 3", f"id = {number}") for number in range(257))
    assert complaint(load_fleet, write(robots)) == "robots: a fleet has at most 256 robots, got 257"
    wish = '[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 1\n'
    assert complaint(load_objective_set, write(33 * wish)) == "objectives: at most 32 at once, got 33"
    assert len(load_objective_set(write(32 * wish)).objectives) == 32


def test_unknown_robot_lists_the_known_ones(write):
    with pytest.raises(ConfigError, match=r"none has id 7 \(--robot-id\); known ids: 3$"):
        load_fleet(write(ROBOTS)).robot(7)
