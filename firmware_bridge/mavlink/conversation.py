"""What an autopilot says within a bounded time when it is only asked: nothing of it changes."""

import select
import time

from firmware_bridge.mavlink.channel import Channel
from firmware_bridge.mavlink.engagement import LISTENING_S
from firmware_bridge.mavlink.facts import Facts
from firmware_bridge.mavlink.messages import Command
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import Profile, find_profile
from firmware_bridge.mavlink.streams import ATTITUDE, EXTENDED_SYS_STATE, GPS_RAW_INT, LOCAL_POSITION_NED

LISTEN_S = 5.0
"""Heartbeats come every second; a bad radio needs a few, and as long for the answers."""
ASK_AGAIN_S = 0.4
_REQUEST_MESSAGE = 512


class Heard:
    """What an autopilot said within a bounded time."""

    def __init__(self, channel: Channel, facts: Facts) -> None:
        self.channel = channel
        self.facts = facts
        self.now_s = 0.0


def listen(options: MavlinkOptions) -> Heard:
    """Wait for a heartbeat and for the answers to what a run must know.

    Asks for parameters, for the time and for single messages, which changes nothing; an autopilot behind
    ``udpout`` learns from that where to send.

    Raises:
        EdgeError: if key or port cannot be used, or the port is lost.
    """
    channel = Channel(options)
    heard = Heard(channel, Facts(find_profile(options.autopilot), options, 0, 0.0))
    channel.open()
    try:
        _converse(heard, find_profile(options.autopilot))
    finally:
        channel.close()
    return heard


def _converse(heard: Heard, profile: Profile) -> None:
    channel, told = heard.channel, heard.facts
    wanted = (ATTITUDE, LOCAL_POSITION_NED, profile.estimator_message, GPS_RAW_INT, EXTENDED_SYS_STATE)
    heard.now_s = begin_s = ask_s = time.monotonic()
    end_s = begin_s + LISTEN_S
    while heard.now_s < end_s and not (_complete(told) and heard.now_s - begin_s >= LISTENING_S):
        if heard.now_s >= ask_s:
            requests = [Command(_REQUEST_MESSAGE, (float(message),)) for message in wanted]
            for question in (*told.questions(heard.now_s), *requests):
                channel.send(question, heard.now_s)
            ask_s = heard.now_s + ASK_AGAIN_S
        select.select(channel.filenos(), (), (), max(min(ask_s, end_s) - heard.now_s, 0.0))
        heard.now_s = time.monotonic()
        for content in channel.receive():
            told.take(content, heard.now_s)


def _complete(told: Facts) -> bool:
    known = told.vehicle.heartbeat is not None and told.explained and told.estimate.state is not None
    return known and told.soundness.told
