"""Finding an autopilot: who it is, its clock, its parameters, what it grants to send. Blocks for seconds."""

import select
from collections.abc import Callable

from edge_runtime.errors import BridgeError
from firmware_bridge.mavlink.channel import Channel
from firmware_bridge.mavlink.facts import Facts
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.streams import Streams

OPENING_S = 10.0
ANSWERING_S = 3.0
"""For each thing that an autopilot is asked."""
ASK_AGAIN_S = 0.2


class Opening:
    """Asks until everything is known that can be; only ``open`` of the link waits for it."""

    def __init__(
        self,
        channel: Channel,
        facts: Facts,
        streams: Streams,
        options: MavlinkOptions,
        clock: Callable[[], float],
    ) -> None:
        self._channel = channel
        self._facts = facts
        self._streams = streams
        self._options = options
        self._now = clock

    def complete(self, receive: Callable[[float], None]) -> None:
        """Find the autopilot and ask it; ``receive`` takes in what has arrived.

        Raises:
            BridgeError: if none is there, it is another kind than the profile's, or it answers nothing.
        """
        facts, streams = self._facts, self._streams
        self._await(lambda: facts.vehicle.heartbeat is not None, OPENING_S, receive)
        if facts.vehicle.heartbeat is None:
            raise BridgeError(silence(self._channel, self._options, OPENING_S))
        if misfit := facts.vehicle.misfit:
            raise BridgeError(misfit)
        self._await(lambda: facts.clock.synchronised, ANSWERING_S, receive)
        if not facts.clock.synchronised:
            raise BridgeError(deafness(self._options))
        self._await(lambda: facts.explained, ANSWERING_S, receive)
        if facts.loop_rate_hz is not None:
            streams.grant(facts.loop_rate_hz)
        streams.begin()
        self._await(lambda: streams.settled, OPENING_S, receive)
        self._await(lambda: facts.estimate.state is not None, ANSWERING_S, receive)

    def _await(self, settled: Callable[[], bool], longest_s: float, receive: Callable[[float], None]) -> None:
        """Block until something is known or time is up; asks what is not, every 0.2 s."""
        ask_s = self._now()
        end_s = ask_s + longest_s
        while not settled() and (now_s := self._now()) < end_s:
            if now_s >= ask_s:
                for question in self._facts.questions(now_s):
                    self._channel.send(question, now_s)
                ask_s = now_s + ASK_AGAIN_S
            select.select(self._channel.filenos(), (), (), max(ask_s - self._now(), 0.0))
            receive(self._now())


def silence(channel: Channel, options: MavlinkOptions, waited_s: float) -> str:
    """Say what was heard instead of an autopilot, and what to check."""
    tally = channel.tally
    refused = ", ".join(f"{count} {why.name.lower()}" for why, count in tally.refused.items() if count)
    heard = f"{tally.accepted} frames of others, {tally.damaged} damaged"
    heard += f", {refused} refused by signing" if refused else ""
    heard += f", {channel.impostors} heartbeats under its number that say no autopilot sent them" * bool(
        channel.impostors
    )
    return (
        f"no heartbeat of system {options.system_id} on {options.address} within {waited_s:g} s ({heard}): "
        "check power, wiring, port, --mavlink-system, MAVLink 2 and the signing key"
    )


def deafness(options: MavlinkOptions) -> str:
    """Say that an autopilot is heard and hears nothing, and what to check."""
    key = "the signing key" if options.signing_key else "whether it wants signed frames"
    return (
        f"system {options.system_id} sends heartbeats but answers nothing: check {key} "
        "(--mavlink-signing-key) and the wire towards it"
    )
