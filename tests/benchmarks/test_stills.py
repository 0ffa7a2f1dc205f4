"""The pictures of edge-watch and edge-report: of a team that drives, or one line why not."""

import shutil

import pytest
from paths import ROOT
from PIL import Image
from ports import free_port

from benchmarks import stills
from edge_runtime.errors import ConfigError

PICTURES = ("edge-watch.png", "report-desktop.png", "report-phone.png")


def test_without_a_browser_it_says_how_to_get_one(tmp_path, monkeypatch):
    pytest.importorskip("playwright")
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    with pytest.raises(ConfigError, match="chromium is not installed; run: make chromium"):
        stills.main(["--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


@pytest.mark.integration
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium: make chromium")
def test_the_documentations_pictures_are_drawn(tmp_path, monkeypatch):
    fleet = stills.FLEET.read_text()
    for port in (47000, 47001, 47002, 47003, 47900):
        fleet = fleet.replace(f"127.0.0.1:{port}", "{}:{}".format(*free_port()))
    (tmp_path / "udp.toml").write_text(fleet)
    monkeypatch.setattr(stills, "FLEET", tmp_path / "udp.toml")
    assert stills.main(["--out", str(tmp_path)]) == 0
    for name in PICTURES:
        with Image.open(tmp_path / name) as drawn, Image.open(ROOT / "docs" / "pictures" / name) as shown:
            assert drawn.width == shown.width
            assert len(drawn.convert("RGB").getcolors(1 << 24)) > 20
