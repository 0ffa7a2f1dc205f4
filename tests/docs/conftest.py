"""The documentation as a reader's browser gets it."""

import subprocess
import sys

import pytest
from paths import ROOT


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """The pages as a reader's browser gets them; any warning is an error."""
    site = tmp_path_factory.mktemp("site")
    line = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(site)]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return site
