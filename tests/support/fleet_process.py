"""One robot of a team as a process: python fleet_process.py FLEET ID LOSS.

It shares a state at 50 Hz on a network that loses packets, prints what it saw in each tick, and on SIGTERM
or an operator's stop what became of the frames.
"""

import random
import sys
import time
from pathlib import Path

import msgspec
from bundles import MANIFEST

from edge_runtime.common.signals import StopSignals
from edge_runtime.config.fleet import load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.control.rate import DeadlineGrid
from edge_runtime.messages import Command, RobotState
from edge_runtime.network.seal import Magic
from edge_runtime.policy.bundle import Bundle
from edge_runtime.team.membership import LocalTeam, open_fleet


class Lossy:
    """A carrier on a network that loses packets."""

    def __init__(self, carrier, loss, seed):
        self.carrier, self.loss, self.random = carrier, loss, random.Random(seed)
        self.failures, self.close = carrier.failures, carrier.close

    def send(self, robot_id, packet):
        if not self.lost():
            self.carrier.send(robot_id, packet)

    def reply(self, datagram, packet):
        if not self.lost():
            self.carrier.reply(datagram, packet)

    def receive(self):
        """Robots' packets were lost on sending; the operator's are lost here."""
        for datagram in self.carrier.receive():
            if not datagram.content.startswith(Magic.ORDER) or not self.lost():
                yield datagram

    def lost(self):
        return self.random.random() < self.loss


def show(record):
    print(msgspec.json.encode(record).decode(), flush=True)


def main(fleet_file, robot_id, loss):
    fleet = load_fleet(Path(fleet_file))
    mission = Mission(robot_id, fleet, Bundle(MANIFEST, None, Path()), fleet.objective_set, 50.0)
    grid = DeadlineGrid(mission.period_s)
    with StopSignals() as signals, open_fleet(mission, LocalTeam(None)) as link:
        link._carrier = link._service._carrier = Lossy(link._carrier, loss, robot_id)
        version = 0
        while not (signals.reason or link.stop_reason):
            grid.wait()
            own = RobotState(robot_id, time.monotonic(), (0.1 * robot_id, 0.0), (0.0, 0.0))
            team = link.team(link.locate(own))
            link.share(own, Command(robot_id, 0, own.stamp_s, (0.0, 0.0), (0.0, 0.0)))
            newest = {other: peer.newest.sequence for other, peer in link._peers.items() if peer.newest}
            if guide := link.new_guide():
                version = guide.version
            mates = [mate.state.robot_id for mate in team.teammates]
            refused = sum(link.report().refused.values())
            show(
                {"mates": mates, "newest": newest, "tick": link.tick, "version": version, "refused": refused}
            )
        show(link.report())


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))
