"""Who vouches for a bundle: changed, unsigned, wrongly signed and older ones are refused; nothing moves."""

import json
import re
import sys

import msgspec
import pytest
from bundles import write_straight_bundle
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.config.fleet import load_fleet
from edge_runtime.control.trust import note_run, require_trusted
from edge_runtime.errors import BundleError, ConfigError
from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.signature import (
    SIGNATURE_FILE,
    Signature,
    check_signature,
    read_signature,
    sign,
    statement,
)
from edge_runtime.policy.version_ledger import VersionLedger
from edge_runtime.run.edge_run import main

nacl = pytest.importorskip("nacl.bindings")
SEED = bytes(range(32))
OTHER = bytes(range(1, 33))
SHA256 = "5a" * 32


def public(seed):
    return nacl.crypto_sign_seed_keypair(seed)[0].hex()


@pytest.fixture
def bundle(tmp_path):
    return write_straight_bundle(tmp_path / "straight")


@pytest.fixture
def fleet(tmp_path, monkeypatch):
    """A fleet that trusts one key, whose robots have run nothing yet."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    path = tmp_path / "team.toml"
    robot = "[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\n"
    path.write_text(f'[team]\ntrusted_keys = ["{public(SEED)}"]\npolicy = "./straight"\n{robot}')
    return path


def signed(directory, version, seed=SEED):
    return sign(directory, load_bundle(directory).sha256, version, seed)


def test_the_signature_is_ed25519_over_version_and_manifest(tmp_path):
    """The library's own bindings agree: nothing but the stated bytes was signed."""
    made = sign(tmp_path, SHA256, 7, SEED)
    assert statement(7, SHA256) == f"cfpg-signature/1\nversion 7\nmanifest {SHA256}\n".encode()
    opened = nacl.crypto_sign_open(
        bytes.fromhex(made.signature) + statement(7, SHA256), bytes.fromhex(made.key)
    )
    assert opened == statement(7, SHA256)
    assert (
        check_signature(tmp_path, SHA256, (public(OTHER), public(SEED))) == made == read_signature(tmp_path)
    )


@given(st.integers(0, 63), st.sampled_from(["signature", "version", "manifest"]))
def test_whatever_is_changed_is_noticed(tmp_path_factory, place, what):
    folder = tmp_path_factory.mktemp("signed")
    made = sign(folder, SHA256, 7, SEED)
    digit = "0" if made.signature[place] != "0" else "1"
    changed = {
        "signature": {"signature": made.signature[:place] + digit + made.signature[place + 1 :]},
        "version": {"version": 8 + place},
        "manifest": {},
    }[what]
    sha256 = SHA256[:place] + "0" + SHA256[place + 1 :] if what == "manifest" else SHA256
    (folder / SIGNATURE_FILE).write_bytes(msgspec.json.encode(msgspec.structs.replace(made, **changed)))
    with pytest.raises(BundleError, match="is not what was signed"):
        check_signature(folder, sha256, (public(SEED),))


@pytest.mark.parametrize(
    "content", [b"", b"{}", b"[" * 4000, b'{"format": "cfpg-signature/2"}', b"\xff", b"x" * 9999]
)
def test_what_is_no_signature_is_one_line(tmp_path, content):
    (tmp_path / SIGNATURE_FILE).write_bytes(content)
    with pytest.raises(BundleError, match="sign the bundle again") as caught:
        read_signature(tmp_path)
    assert "\n" not in str(caught.value)


def test_weak_keys_vouch_for_nobody(tmp_path):
    """The neutral element would verify what nobody signed."""
    weak = "01" + "00" * 31
    forged = Signature("cfpg-signature/1", 1, weak, weak + "00" * 32)
    (tmp_path / SIGNATURE_FILE).write_bytes(msgspec.json.encode(forged))
    with pytest.raises(BundleError):
        check_signature(tmp_path, SHA256, (weak,))


def run(fleet, capsys, *flags):
    code = main(["--robot-id", "0", "--fleet", str(fleet), "--duration", "0.05", "--no-log", *flags])
    return code, capsys.readouterr().err


@pytest.mark.parametrize(("harm", "said"), [
    ("none", "is not signed, and trusted_keys of [team] says who must have signed it"),
    ("other key", f"signed by {public(OTHER)}, which is none of [team]'s trusted_keys"),
    ("other bundle's", "this bundle is not what was signed"),
    ("weights", "does not match its digest"),
])  # fmt: skip
def test_a_robot_refuses_and_nothing_moves(bundle, fleet, capsys, harm, said):
    if harm == "other key":
        signed(bundle, 1, OTHER)
    if harm == "other bundle's":
        sign(bundle, SHA256, 1, SEED)
    if harm == "weights":
        signed(bundle, 1)
        (bundle / "policy.npz").write_bytes(b"changed")
    code, complaint = run(fleet, capsys)
    assert code == 2
    assert said in complaint and complaint.count("\n") == 1


def test_a_robot_goes_back_behind_no_version_unless_told(bundle, fleet, capsys):
    for version, flags, code in (
        (2, (), 0),
        (1, (), 2),
        (2, (), 0),
        (1, ("--allow-rollback",), 0),
        (1, (), 0),
    ):
        signed(bundle, version)
        assert run(fleet, capsys, *flags)[0] == code
    signed(bundle, 3)
    assert run(fleet, capsys, "--dry-run")[0] == 0  # it drove nobody: 1 is still the newest that was run
    signed(bundle, 1)
    assert run(fleet, capsys)[0] == 0


def test_who_starts_with_the_policy_before_is_told_where_the_handed_one_lies(bundle, fleet):
    loaded = load_fleet(fleet)
    signed(bundle, 2)
    note_run(load_bundle(bundle), loaded, 0)
    signed(bundle, 1)
    received = VersionLedger(0).path.with_suffix("")
    received.mkdir(exist_ok=True)
    with pytest.raises(BundleError, match=re.escape(f"what it was handed lies in {received}")):
        require_trusted(load_bundle(bundle), loaded, 0)


def test_another_robot_of_the_same_machine_has_a_memory_of_its_own(bundle, fleet):
    loaded = load_fleet(fleet)
    signed(bundle, 2)
    note_run(load_bundle(bundle), loaded, 0)
    signed(bundle, 1)
    require_trusted(load_bundle(bundle), loaded, 1)
    with pytest.raises(BundleError, match="version 1 of policy 'straight' is older than version 2"):
        require_trusted(load_bundle(bundle), loaded, 0)


def test_a_damaged_memory_is_said_and_not_taken_for_none(bundle, fleet, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    signed(bundle, 2)
    assert run(fleet, capsys)[0] == 0
    (ledger,) = (tmp_path / "state").rglob("robot0.json")
    assert json.loads(ledger.read_text()) == {"straight": 2}
    ledger.write_text("{")
    code, complaint = run(fleet, capsys)
    assert code == 2 and "is damaged" in complaint


def test_without_the_library_one_line_says_what_to_install(bundle, fleet, capsys, monkeypatch):
    signed(bundle, 1)
    monkeypatch.setitem(sys.modules, "nacl.signing", None)
    code, complaint = run(fleet, capsys)
    assert code == 2 and "pip install 'cfpg-edge[sign]'" in complaint


def test_keys_are_checked_when_the_fleet_file_is_read(fleet):
    fleet.write_text(fleet.read_text().replace(public(SEED), "my key"))
    with pytest.raises(ConfigError, match="`trusted_keys` must be public keys of 64 hexadecimal digits"):
        load_fleet(fleet)
