"""A network in memory and a clock that the test moves, for teams without sockets."""

import itertools
import random
import threading
from collections import Counter, deque
from pathlib import Path

from bundles import MANIFEST

from edge_runtime.config.objectives import parse_objective_set
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import Command, RobotState
from edge_runtime.network.datagrams import Datagram
from edge_runtime.team.link import NetworkTeam, TeamRules
from edge_runtime.team.order_service import OrderService
from edge_runtime.team.orders import Orders
from edge_runtime.team.streams import Streams

KEY = bytes(range(32))
PERIOD_S = 0.02
OPERATOR = "operator"
"""The queue that answers to an operator go to."""


class Network:
    """Delivers packets by the end of the tick in which they were sent, except those that it loses."""

    def __init__(self, loss=0.0, seed=0):
        self.queues = {}
        self.loss, self.random = loss, random.Random(seed)
        self.dead = set()
        self.recorded = []

    def carrier(self, robot_id, clock):
        self.queues[robot_id] = deque()
        return MemoryCarrier(self, robot_id, clock)

    def carry(self, sender, receiver, packet):
        self.recorded.append((sender, receiver, packet))
        lost = self.random.random() < self.loss or self.dead & {sender, receiver}
        if not lost and receiver in self.queues:
            self.queues[receiver].append(packet)


class MemoryCarrier:
    def __init__(self, network, robot_id, clock):
        self.failures = Counter()
        self.clock = clock
        self.network, self.robot_id = network, robot_id
        self.closed = False

    def send(self, robot_id, packet):
        self.network.carry(self.robot_id, robot_id, packet)

    def reply(self, datagram, packet):
        self.network.carry(self.robot_id, datagram.source, packet)

    def receive(self):
        queue, now_s = self.network.queues[self.robot_id], self.clock()
        while queue:
            yield Datagram(queue.popleft(), OPERATOR, now_s)

    def close(self):
        self.closed = True


class World:
    """Robots on a line, one metre apart, that tick one after the other."""

    def __init__(self, count, network=None, neighbours=None, asked=None, **rules):
        self.now_s, self.count = 100.0, count
        self.network = network or Network()
        self.neighbours, self.rules, self.asked = neighbours or {}, rules, asked or {}
        self.position = {robot_id: (float(robot_id), 0.0) for robot_id in range(count)}
        self.teams = {robot_id: self.make(robot_id) for robot_id in range(count)}
        self.offset_s = {robot_id: 1000.0 * robot_id for robot_id in range(count)}

    def make(self, robot_id, key=KEY, nonces=None):
        others = tuple(other for other in range(self.count) if other != robot_id)
        neighbours = self.neighbours.get(robot_id, others)
        rules = TeamRules(
            neighbours=neighbours,
            nearest=min(self.rules.get("nearest", self.count), len(neighbours)),
            stale_s=3 * PERIOD_S,
            alone_s=self.rules.get("alone_s", 0.2),
            missing_s=self.rules.get("missing_s", 1.0),
            receiving_s=0.1 * PERIOD_S,
            period_s=PERIOD_S,
        )
        nonce = (lambda: next(nonces)) if nonces else itertools.count(robot_id * 2**32 + 1).__next__
        carrier = self.network.carrier(robot_id, lambda: self.clock(robot_id))
        guide = make_guide(self.asked.get(robot_id, ObjectiveSet()), MANIFEST.motion)
        service = OrderService(Orders(robot_id, nonce(), guide, self.guide_of), key, carrier, 1 / PERIOD_S)
        streams, clock = Streams(robot_id, None, None, key), lambda: self.clock(robot_id)
        return NetworkTeam(robot_id, others, rules, carrier, key, service, streams, clock, nonce)

    def guide_of(self, file, content):
        return make_guide(parse_objective_set(content, Path(file)), MANIFEST.motion)

    def clock(self, robot_id):
        return self.now_s + self.offset_s[robot_id]

    def own(self, robot_id):
        return RobotState(robot_id, self.clock(robot_id), self.position[robot_id], (0.1, 0.2), 0.3)

    def view(self, robot_id):
        """What a robot sees in a tick."""
        team = self.teams[robot_id]
        return team.team(team.locate(self.own(robot_id)))

    def tick(self):
        """One period: all receive, then all send; returns what each saw."""
        alive = [robot_id for robot_id in self.teams if robot_id not in self.network.dead]
        for robot_id in self.teams.keys() - alive:
            self.network.queues[robot_id].clear()  # else read much later, as if they had come then
        seen = {robot_id: self.view(robot_id) for robot_id in alive}
        for robot_id in alive:
            command = Command(robot_id, 0, self.clock(robot_id), (0.5, -0.5), (0.0, 0.0))
            self.teams[robot_id].share(self.own(robot_id), command)
        self.now_s += PERIOD_S
        return seen

    def ticks(self, count):
        return [self.tick() for _ in range(count)]

    def end_checks(self):
        """Wait for the threads in which the robots check what is proposed to them."""
        for thread in threading.enumerate():
            if thread.name == "proposal":
                thread.join()


def ids(team):
    return [mate.state.robot_id for mate in team.teammates]
