"""What edge-pose plays, and edge-report draws beside logs: recorded poses and ranges, edge-sil's reports."""

import csv
import io
import json

import msgspec
import sil_reports

from edge_runtime.tools.pose.recording import read_recording
from edge_runtime.tools.report.sil_page import load_page
from hostile.values import NUMBERS, TEXTS, as_json, change_bytes, change_tree

POSES = [{"t": 0.01 * k, "robot": k % 2, "x": 0.1 * k, "y": -1.0, "heading": 0.1} for k in range(20)]
FLYING = [{**pose, "z": 1.0, "vx": 0.1, "vy": 0.0, "vz": 0.2} for pose in POSES]
RANGES = [{"t": 0.01 * k, "robot": 0, "ranges": [0.1, 0.35]} for k in range(20)]
REPORT = msgspec.json.encode(sil_reports.report(*map(sil_reports.robot, range(3))))


def prepare(folder):
    return folder


def attempt(draw, folder):
    name, load, content = draw.choice([lines, table, report])(draw)
    path = folder / name
    path.write_bytes(change_bytes(draw, content) if draw.random() < 0.3 else content)
    load(path)


def lines(draw):
    rows = change_tree(
        draw, json.loads(json.dumps(draw.choice([POSES, FLYING, RANGES]))), draw.randrange(1, 4)
    )
    return "case.jsonl", read_recording, b"\n".join(as_json(draw, row) for row in rows)


def table(draw):
    text = io.StringIO()
    writer = csv.writer(text, escapechar="\\")  # without one, Python 3.10 takes NUL for it
    writer.writerow(draw.choice([[*POSES[0]], [*POSES[0], "vx", "vy"], [*FLYING[0]], ["t", "t"], TEXTS]))
    for row in POSES:
        cells = list(row.values())
        cells[draw.randrange(len(cells))] = draw.choice([*NUMBERS, *TEXTS]) if draw.random() < 0.1 else 0
        writer.writerow(cells)
    return "case.csv", read_recording, text.getvalue().encode("utf-8", "replace")


def report(draw):
    tree = change_tree(draw, json.loads(REPORT), draw.randrange(1, 4))
    return "case.json", load_page, as_json(draw, tree)
