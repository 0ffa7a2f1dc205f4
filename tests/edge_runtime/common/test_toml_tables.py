"""Tables whose keys the user chooses: a mistake inside one is named by its own key."""

from pathlib import Path

import msgspec
import pytest

from edge_runtime.common.toml_file import parse_toml, to_record
from edge_runtime.errors import ConfigError

FILE = Path("robot.toml")


class Gain(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    forward: float = 0.0
    kind: str = ""


class Robot(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    motion: dict[str, dict[str, Gain]] = {}
    sides: tuple[dict[str, Gain], ...] = ()
    ages: dict[str, float] = {}
    spare: dict[str, Gain] | None = None


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[motion.A.B]\nforwrd = 1.0", "motion.A.B.forwrd: unknown key; allowed: forward, kind"),
        (
            '[motion.A.B]\nforward = "1"',
            "motion.A.B.forward: Expected `float`, got `str`; write a number without quotes, such as 1",
        ),
        ("[motion.A]\nB = 3", "motion.A.B: Expected `table`, got `int`"),
        ("motion.A = 3", "motion.A: Expected `table`, got `int`"),
        ("[[sides]]\n[[sides]]\nleft.x = 1", "sides[1].left.x: unknown key; allowed: forward, kind"),
        (
            "ages = { a = 1.0, b = '2' }",
            "ages.b: Expected `float`, got `str`; write a number without quotes, such as 2",
        ),
        ("[spare]\ne2e.x = 1", "spare.e2e.x: unknown key; allowed: forward, kind"),
    ],
)
def test_the_key_that_is_wrong_is_named(text, complaint):
    with pytest.raises(ConfigError) as error:
        to_record(parse_toml(text.encode(), FILE), Robot, FILE)
    assert str(error.value) == f"robot.toml: {complaint}"


def test_what_is_right_is_read():
    robot = to_record(parse_toml(b"[motion.A.B]\nforward = 1", FILE), Robot, FILE)
    assert robot.motion == {"A": {"B": Gain(1.0)}}
