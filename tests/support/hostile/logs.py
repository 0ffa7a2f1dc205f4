"""Logs: of a robot's run, with other bytes, other messages, other numbers in them."""

import contextlib
import io
import json

import foreign_logs
from logs import in_space, record
from mcap.writer import CompressionType

from edge_runtime.tools.replay.edge_replay import main as replay
from edge_runtime.tools.report.edge_report import main as report
from hostile.values import as_json, change_bytes, change_tree, value

METHODS = [CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4]


def prepare(folder):
    with contextlib.redirect_stdout(io.StringIO()):
        (log,) = record(folder, "--duration", "0.2", "--backend", "numpy")
    flying = in_space(log, folder / "space.mcap")
    return folder, [(path.read_bytes(), foreign_logs.messages_of(path)) for path in (log, flying)]


def attempt(draw, given):
    folder, logs = given
    content, messages = draw.choice(logs)
    path = folder / "case.mcap"
    match draw.randrange(6):
        case 0:
            path.write_bytes(change_bytes(draw, content))
        case 1:
            size = draw.choice([1 << 20, 1 << 24, 1 << 31])
            claimed = draw.choice([size, 1000, 2**63])
            foreign_logs.with_chunk(path, messages[0][1], foreign_logs.packed_zeros(size), claimed)
        case _:
            foreign_logs.write(path, [*changed(draw, messages)], draw.choice(METHODS))
    command(replay, path)
    command(report, path, "-o", folder / "page.html")


def changed(draw, messages):
    """The messages in their order, a few of them otherwise, missing, twice or elsewhere."""
    messages = list(messages)
    for _ in range(draw.randrange(1, 4)):
        topics = sorted({topic for topic, _ in messages})
        wanted = draw.choice(topics)
        at = draw.choice([place for place, (topic, _) in enumerate(messages) if topic == wanted])
        topic, content = messages[at]
        match draw.randrange(8):
            case 0:
                messages = [each for each in messages if each[0] != topic] or messages
            case 1:
                messages[at:at] = [messages[at]] * draw.choice([1, 2, 300])
            case 2:
                messages.insert(draw.randrange(len(messages)), messages.pop(at))
            case 3:
                messages[at] = topic, change_bytes(draw, content)
            case 4:
                messages[at] = topic, as_json(draw, value(draw))
            case _:
                with contextlib.suppress(ValueError):
                    tree = change_tree(draw, json.loads(content), draw.randrange(1, 3))
                    messages[at] = topic, as_json(draw, tree)
    return messages


def command(main, *arguments):
    """Run a command; what it says is lines, and what goes wrong is one of them."""
    said, complained = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(complained):
        code = main([str(argument) for argument in arguments])
    lines = complained.getvalue().splitlines()
    assert code in (0, 1, 2), code
    assert len(lines) == (code == 2) or code == 1, complained.getvalue()
    assert (said.getvalue() + complained.getvalue()).replace("\n", "").isprintable()
