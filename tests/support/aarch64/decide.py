"""decide.py LOG OUT: makes a log's decisions again on this processor, and writes the log of those."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from logs import write
from msgspec.structs import replace

from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.policy.compiled_policy import CompiledPolicy
from edge_runtime.recording.reader import read_log
from edge_runtime.recording.schema import LoggedObjectiveSet, Start, Tick
from edge_runtime.tools.replay.replay import Replay, recorded_objectives

source, target = map(Path, sys.argv[1:])
records = []
for record in read_log(source):
    if isinstance(record, Start):
        then = record.bundle
        bundle = packaged_bundle(then.name).sampled(then.sampler, then.euler_steps)
        policy = CompiledPolicy(bundle.weights, then.euler_steps, sampler=then.sampler)
        replay = Replay(record, bundle, policy)
        record = replace(record, settings=replace(record.settings, engine=policy.engine))
    elif isinstance(record, LoggedObjectiveSet):
        replay.follow(recorded_objectives(record, source))
    elif isinstance(record, Tick):
        observation = replay.observe(record)
        action = replay.act(record, observation)
        command = replay.limit(record, action, observation)
        record = replace(record, observation=observation, action=action, command=command)
    records.append(record)
write(target, records)
