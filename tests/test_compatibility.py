"""What earlier versions left behind is still read: see CHANGELOG.md, "Compatibility"."""

from paths import SUPPORT

from edge_runtime.tools.replay.edge_replay import main

ARTEFACTS = SUPPORT / "artefacts"


def test_a_log_of_an_earlier_version_replays(capsys):
    """Bit for bit where this processor has the log's instruction set, else within a tolerance."""
    assert main([str(ARTEFACTS / "0.1.0" / "navigation.mcap")]) == 0
    assert "98 ticks" in capsys.readouterr().out
