"""Bundles whose digests fit, from an exporter that means harm."""

import io
import json
import zipfile

import numpy as np
from bundle_files import WEIGHTS, sign, write_bundle

from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.weight_file import pack_weights
from hostile.values import as_json, change_bytes, change_tree

PACKED = pack_weights(WEIGHTS)
METHODS = [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]
SHAPES = [(), (0,), (1,), (2, 8), (8, 2), (2, 8, 1), (4096, 2), (2, 4096), (1, 100_000)]
TYPES = ["<f4", "<f4", ">f4", "<f8", "<f2", "<i4", "|b1", "|S5", "<U3", "<c8", "<M8[s]"]
HEADS = [b"(" * 100, b"{'descr': '|O', ", b"{'descr': '<f4', 'fortran_order': True, 'shape': (9**9**9,), }",
         b"__import__('os').abort()",
         b"{'shape': (1000000, 1000000), 'descr': '<f8', 'fortran_order': False}"]  # fmt: skip


def prepare(folder):
    return folder / "bundle"


def attempt(draw, directory):
    weights = draw.choice([lambda: PACKED, lambda: change_bytes(draw, PACKED), lambda: archive(draw)])()
    write_bundle(directory, weights=weights, graph=draw.randbytes(draw.choice([0, 10, 1000])))
    if draw.random() < 0.7:
        tree = change_tree(draw, json.loads((directory / "manifest.json").read_bytes()), draw.randrange(1, 4))
        sign(directory, as_json(draw, tree))
    if draw.random() < 0.1:
        sign(directory, change_bytes(draw, (directory / "manifest.json").read_bytes()))
    bundle = load_bundle(directory)
    field = bundle.field("numpy" if bundle.weights and draw.random() < 0.5 else "auto")
    field.observe(np.zeros((1, field.observation_dim), np.float32))
    field.step(0, np.ones((1, field.action_dim), np.float32))


def archive(draw):
    """The arrays written anew, with another one, another head or another method among them."""
    with np.load(io.BytesIO(PACKED)) as read:
        arrays = dict(read)
    changed = draw.choice(list(arrays))
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", draw.choice(METHODS)) as file:
        for name, array in arrays.items():
            content = io.BytesIO()
            if name == changed and draw.random() < 0.5:
                array = np.full(draw.choice(SHAPES), draw.choice([0, 1, 3]), draw.choice(TYPES))
            if name == changed and array.dtype.kind == "f" and array.size and draw.random() < 0.5:
                array = array.copy()
                array.flat[0] = draw.choice([np.nan, np.inf, 3e38, 1e-40])
            np.lib.format.write_array(content, array, allow_pickle=False)
            raw = content.getvalue()
            if name == changed and draw.random() < 0.3:
                head = draw.choice(HEADS).ljust(117) + b"\n"
                raw = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + raw[128:]
            for _ in range(draw.choice([1, 1, 1, 2]) if name == changed else 1):
                file.writestr(f"{name}.npy", raw)
    return buffer.getvalue() if draw.random() < 0.7 else change_bytes(draw, buffer.getvalue())
