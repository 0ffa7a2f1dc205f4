"""Signing against node-mavlink, an implementation that nobody of this project wrote."""

import json
import os
import shutil
import struct
import subprocess

import pytest
from paths import SUPPORT
from waiting import HANG_S

from firmware_bridge.mavlink.decoder import Decoder
from firmware_bridge.mavlink.encoder import Encoder
from firmware_bridge.mavlink.messages import Beat, Command, ParameterRequest, Target, TimeSync
from firmware_bridge.mavlink.signing import SignatureCheck, Signing, Timestamps

PEERS = SUPPORT / "peers"
NODE = shutil.which("node")
KEY = bytes(range(32))
ATTACKS = int(os.environ.get("MAVLINK_ATTACK_FRAMES", "4000"))
"""All of them: MAVLINK_ATTACK_FRAMES=100000 pytest tests/firmware_bridge/mavlink/test_node_peer.py."""

pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(
        NODE is None or not (PEERS / "node_modules" / "node-mavlink").is_dir(),
        reason="node-mavlink is not installed: npm install --prefix tests/support/peers --no-package-lock",
    ),
]


def node(*arguments, frames=b""):
    command = [NODE, str(PEERS / "mavlink_peer.mjs"), *arguments]
    return subprocess.run(command, input=frames, capture_output=True, check=True, timeout=HANG_S).stdout


def frames_of(output):
    offset = 0
    while offset < len(output):
        kind, length = struct.unpack_from("<BH", output, offset)
        yield kind, output[offset + 3 : offset + 3 + length]
        offset += 3 + length


@pytest.fixture
def signing(tmp_path):
    return Signing(KEY, Timestamps(tmp_path / "timestamp"))


def test_node_mavlink_verifies_every_frame_that_we_sign(signing):
    encoder = Encoder(255, (1, 1), signing)
    outgoing = (
        Beat(),
        Target(8, 0x5C7, (0.5, 0.0, 0.0), yaw_rate_rad_s=-0.25),
        Command(176, (1.0, 15.0)),
        ParameterRequest("GUID_TIMEOUT"),
        TimeSync(0, 123_456_789),
    )
    frames = b"".join(encoder.encode(content, 12.5) for content in outgoing * 20)
    reports = [json.loads(line) for line in node("verify", KEY.hex(), frames=frames).splitlines()]
    assert len(reports) == 100
    assert all(report["signed"] and report["matches"] for report in reports)
    assert [report["id"] for report in reports[:5]] == [0, 84, 76, 20, 111]
    ticks = [report["tick"] for report in reports]
    assert ticks == sorted(set(ticks))
    setpoint = reports[1]["fields"]
    assert (setpoint["typeMask"], setpoint["coordinateFrame"]) == (0x5C7, 8)
    assert (setpoint["vx"], setpoint["vy"], setpoint["yawRate"]) == (0.5, 0.0, -0.25)


def test_node_mavlink_does_not_verify_them_with_another_key(signing):
    frame = Encoder(255, (1, 1), signing).encode(Beat(), 0.0)
    (report,) = [json.loads(line) for line in node("verify", KEY[::-1].hex(), frames=frame).splitlines()]
    assert report["signed"]
    assert not report["matches"]


def test_frames_that_node_mavlink_signed_are_accepted(signing):
    decoder = Decoder(signing)
    frames = b"".join(frame for _, frame in frames_of(node("genuine", KEY.hex(), "50")))
    positions = [received.content.position_m for received in decoder.feed(frames)]
    assert positions == [(float(n), float(-n)) for n in range(1, 51)]


def test_no_unsigned_replayed_or_altered_frame_is_accepted(signing):
    decoder = Decoder(signing)
    # The recorded frame of the attacks is one that was accepted when it was new.
    recorded = next(frame for kind, frame in frames_of(node("attack", KEY.hex(), "8")) if kind == 2)
    assert len(list(decoder.feed(recorded))) == 1
    attacks = list(frames_of(node("attack", KEY.hex(), str(ATTACKS))))
    assert len(attacks) == ATTACKS
    frames = (recorded if kind == 2 else frame for kind, frame in attacks)
    accepted = [r for frame in frames for r in decoder.feed(frame, whole=True)]
    assert accepted == []
    refused = decoder.tally.refused
    assert sum(refused.values()) == ATTACKS
    assert refused[SignatureCheck.UNSIGNED] == sum(kind in (0, 7) for kind, _ in attacks)
    assert refused[SignatureCheck.REPLAYED] == sum(kind == 2 for kind, _ in attacks)
    assert decoder.tally.damaged == 0
