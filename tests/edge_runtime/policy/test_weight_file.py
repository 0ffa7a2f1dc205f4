"""policy.npz: the same bytes for the same weights, refused unless every array fits."""

import dataclasses
import io
import time

import numpy as np
import pytest
from bundle_files import MANIFEST, WEIGHTS, write_bundle

from edge_runtime.errors import BundleError
from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.weight_file import pack_weights, unpack_weights


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


def test_the_bundle_names_its_file(tmp_path):
    directory = write_bundle(tmp_path / "tiny", weights=npz({}))
    with pytest.raises(BundleError, match=f"{directory / 'policy.npz'}: has arrays"):
        load_bundle(directory)
