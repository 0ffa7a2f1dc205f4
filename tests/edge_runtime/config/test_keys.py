"""The keys that a fleet file names."""

import os
import secrets

import pytest

from edge_runtime.config.fleet import load_fleet
from edge_runtime.config.keys import operator_key, team_key
from edge_runtime.errors import ConfigError

ROBOT = '[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 1]\naddress = "127.0.0.1:47000"\n'


@pytest.fixture
def make(tmp_path):
    """Writes keys of these names, and a fleet file with this carrier."""

    def make_fleet(carrier, *names):
        for name in names:
            (tmp_path / name).write_bytes(secrets.token_bytes(32))
            (tmp_path / name).chmod(0o600)
        (tmp_path / "team.toml").write_text(f"{ROBOT}[carrier]\n{carrier}\n")
        return load_fleet(tmp_path / "team.toml")

    return make_fleet


def test_operators_have_the_teams_key_or_one_of_their_own(make, tmp_path):
    fleet = make('key = "team.key"', "team.key")
    assert operator_key(fleet) == team_key(fleet) == (tmp_path / "team.key").read_bytes()
    fleet = make('key = "team.key"\noperator_key = "operator.key"', "operator.key")
    assert operator_key(fleet) == (tmp_path / "operator.key").read_bytes() != team_key(fleet)


def test_another_file_stands_for_the_one_that_the_fleet_names(make, tmp_path):
    fleet = make('key = "missing.key"', "other.key")
    assert team_key(fleet, tmp_path / "other.key") == operator_key(fleet, tmp_path / "other.key")


def test_a_key_that_cannot_be_used_names_file_and_field(make):
    with pytest.raises(ConfigError, match=r"team.toml: carrier.key: key .*none.key: No such file"):
        team_key(make('key = "none.key"'))
    fleet = make('key = "team.key"\noperator_key = "none.key"', "team.key")
    with pytest.raises(ConfigError, match=r"team.toml: carrier.operator_key: key .*none.key: No such file"):
        operator_key(fleet)


def test_a_user_without_a_home_directory_is_told_so(make, monkeypatch):
    fleet = make('key = "~/team.key"')
    monkeypatch.delenv("HOME")
    monkeypatch.setattr(os, "getuid", lambda: 2**31 - 2)
    with pytest.raises(ConfigError, match=r"carrier.key: ~/team.key: this user has no home directory"):
        team_key(fleet)
