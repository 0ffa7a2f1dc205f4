"""policy.npz: the same bytes for the same weights, refused unless every array fits."""

import contextlib
import dataclasses
import io
import time
import tracemalloc
import zipfile

import numpy as np
import pytest
from bundle_files import MANIFEST, WEIGHTS, write_bundle
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_runtime.errors import BundleError
from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.weight_file import pack_weights, unpack_weights

PACKED = pack_weights(WEIGHTS)


def arrays():
    with np.load(io.BytesIO(pack_weights(WEIGHTS))) as archive:
        return dict(archive)


def npz(named):
    buffer = io.BytesIO()
    np.savez(buffer, **named)
    return buffer.getvalue()


def refusal(content):
    with pytest.raises(BundleError) as caught:
        unpack_weights(content, MANIFEST, "policy.npz")
    return str(caught.value)


def test_bytes_do_not_depend_on_the_clock(monkeypatch):
    first = pack_weights(WEIGHTS)
    monkeypatch.setattr(time, "localtime", lambda *_: time.gmtime(2**31))
    monkeypatch.setattr(time, "time", lambda: 2.0**31)
    assert pack_weights(WEIGHTS) == first


def test_bytes_do_not_depend_on_the_memory_layout():
    transposed = dataclasses.replace(WEIGHTS, action=np.asfortranarray(WEIGHTS.action))
    assert pack_weights(transposed) == pack_weights(WEIGHTS)


@pytest.mark.parametrize("name", sorted(arrays()))
def test_every_array_is_checked(name):
    good = arrays()
    bad_values = good[name].copy()
    bad_values.flat[-1] = np.nan
    assert refusal(npz({**good, name: bad_values})) == (
        f"policy.npz: array {name} holds values that are not finite"
    )
    assert f"array {name} is float64" in refusal(npz({**good, name: good[name].astype(float)}))
    assert f"array {name} is float32" in refusal(npz({**good, name: good[name][None]}))
    without = {other: array for other, array in good.items() if other != name}
    assert "policy.npz: has arrays" in refusal(npz(without))


def test_wrong_shape_tells_both_shapes():
    message = refusal(npz({**arrays(), "matrix_1": np.zeros((8, 7), np.float32)}))
    assert message == (
        "policy.npz: array matrix_1 is float32 (8, 7), the manifest's fields and layers need float32 (8, 6)"
    )


def test_unknown_array_is_refused():
    assert "extra" in refusal(npz({**arrays(), "extra": np.zeros(1, np.float32)}))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\x93NUMPY", pack_weights(WEIGHTS)[:-30]])
def test_no_archive(content):
    assert refusal(content).startswith("policy.npz: not a readable npz archive of plain arrays")


def test_nothing_is_unpickled():
    objects = npz({**arrays(), "action": np.array([print, None], object)})
    assert "not a readable npz archive of plain arrays" in refusal(objects)


def member(shape=b"(2, 8)", kind=b"<f4", data=bytes(64), head=None):
    head = head or b"{'descr': '%s', 'fortran_order': False, 'shape': %s, }" % (kind, shape)
    head = head.ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + data


def archive_of(*members, method=zipfile.ZIP_STORED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return buffer.getvalue()


def with_last_member_larger(size):
    """Let the directory claim a member of this size."""
    content = bytearray(archive_of(("action.npy", member())))
    at = content.rindex(b"PK\x01\x02") + 20  # compressed size, then size
    content[at : at + 8] = size.to_bytes(4, "little") * 2
    return bytes(content)


def overlapping():
    """A directory that names one member a thousand times."""
    content = archive_of(("action.npy", member(data=bytes(1 << 16))))
    at, end = content.rindex(b"PK\x01\x02"), content.rindex(b"PK\x05\x06")
    entry, count = content[at:end], 1000
    tail = bytearray(content[end:])
    tail[8:12] = count.to_bytes(2, "little") * 2
    tail[12:16] = (count * len(entry)).to_bytes(4, "little")
    return content[:at] + entry * count + bytes(tail)


HOSTILE = {
    "deflate bomb": archive_of(("action.npy", member(data=bytes(1 << 26))), method=zipfile.ZIP_DEFLATED),
    "LZMA": archive_of(("action.npy", member()), method=zipfile.ZIP_LZMA),
    "bzip2": archive_of(("action.npy", member()), method=zipfile.ZIP_BZIP2),
    "a member of 4 GB": with_last_member_larger(2**32 - 2),
    "members that overlap": overlapping(),
    "a shape of 4 TB": archive_of(("action.npy", member(b"(1000000, 1000000)"))),
    "a shape of 80 digits": archive_of(("action.npy", member(b"(%s,)" % (b"9" * 60)))),
    "parentheses": archive_of(("action.npy", member(head=b"(" * 60))),
    "an expression": archive_of(("action.npy", member(b"(9**9**9,)"))),
    "no such type": archive_of(("action.npy", member(kind=b"<f3"))),
    "a head of 64 KiB": archive_of(("action.npy", member().replace(b"v\x00", b"\xff\xff", 1))),
    "no array": archive_of(("action.npy", b"")),
}  # fmt: skip


@pytest.mark.parametrize("what", HOSTILE)
def test_hostile_archives_take_neither_memory_nor_time(what):
    content = HOSTILE[what]
    tracemalloc.start()
    try:
        assert "not a readable npz archive of plain arrays" in refusal(content)
        assert tracemalloc.get_traced_memory()[1] < 10 * len(content) + (1 << 20)
    finally:
        tracemalloc.stop()


@settings(max_examples=300, deadline=None)
@given(
    edits=st.lists(st.tuples(st.integers(0, len(PACKED) - 1), st.integers(0, 255)), min_size=1, max_size=8)
)
def test_bytes_of_an_archive_that_change_are_refused_or_loaded(edits):
    content = bytearray(PACKED)
    for position, byte in edits:
        content[position] = byte
    with contextlib.suppress(BundleError):
        unpack_weights(bytes(content), MANIFEST, "policy.npz")


def test_more_frequencies_than_any_network_has():
    count = 1025
    many = {
        "time": np.zeros((1 + count, 8), np.float32),
        "time_frequency": np.zeros(count, np.float32),
        "time_phase": np.zeros(count, np.float32),
    }
    assert "has 1025 frequencies of flow time, at most 1024" in refusal(npz({**arrays(), **many}))


def test_the_bundle_names_its_file(tmp_path):
    directory = write_bundle(tmp_path / "tiny", weights=npz({}))
    with pytest.raises(BundleError, match=f"{directory / 'policy.npz'}: has arrays"):
        load_bundle(directory)
