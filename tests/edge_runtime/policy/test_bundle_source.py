"""Policies from a directory, and from a hub that is played here: fetched once, cached, verified."""

import hashlib
import json
import os
import re
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from bundles import write_straight_bundle

from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle_source import is_remote, located
from edge_runtime.policy.schema import LARGEST_FILE

COMMIT = "c0" * 20
RUN = [sys.executable, "-m", "edge_runtime.run", "--robot-id", "0", "--duration", "0.05", "--no-log"]


def test_directories_are_taken_as_they_are(tmp_path):
    assert located("./mine", tmp_path) == tmp_path / "mine"
    assert located("/policies/mine", tmp_path) == Path("/policies/mine")
    assert not is_remote("./hf/mine")


@pytest.mark.parametrize(
    "name", ["hf://", "hf://owner", "hf://owner/name/more", "hf://owner/na me", "hf://o/n@"]
)
def test_what_is_no_repository_is_told_how_to_write_one(name):
    with pytest.raises(ConfigError, match="must be such as hf://owner/name"):
        located(name)


def test_without_the_client_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(ConfigError, match=re.escape("pip install 'cfpg-edge[hub]'")):
        located("hf://owner/name")


class Hub:
    """Answers as the Hub does for one repository of one commit."""

    def __init__(self, folder):
        self.folder, self.asked = folder, []
        hub = self

        class Handler(BaseHTTPRequestHandler):
            def do_HEAD(self):
                self.do_GET(body=False)

            def do_GET(self, *, body=True):
                hub.asked.append(self.path)
                path = self.path.partition("?")[0]
                if path.startswith("/api/models/owner/name/tree/"):
                    tree = [hub.entry(each) for each in hub.folder.iterdir()]
                    return self.answer(json.dumps(tree).encode(), body)
                if path.startswith("/api/models/owner/name"):
                    files = [{"rfilename": each.name} for each in hub.folder.iterdir()]
                    known = {"id": "owner/name", "sha": COMMIT, "siblings": files}
                    return self.answer(json.dumps(known).encode(), body)
                found = re.fullmatch(rf"/owner/name/resolve/{COMMIT}/([\w.]+)", path)
                if found and (hub.folder / found[1]).exists():
                    return self.answer((hub.folder / found[1]).read_bytes(), body)
                return self.answer(b"", body, 404)

            def answer(self, content, body, code=200):
                self.send_response(code)
                self.send_header("Content-Length", str(len(content)))
                self.send_header("ETag", f'"{hashlib.sha1(content).hexdigest()}"')  # noqa: S324
                self.send_header("X-Repo-Commit", COMMIT)
                self.send_header("Content-Type", "application/json")
                self.end_headers()
                if body:
                    self.wfile.write(content)

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()

    def entry(self, path):
        content = path.read_bytes()
        oid = hashlib.sha1(content).hexdigest()  # noqa: S324
        return {"type": "file", "path": path.name, "size": len(content), "oid": oid}

    def close(self):
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()


@pytest.fixture
def hub(tmp_path):
    pytest.importorskip("huggingface_hub")
    played = Hub(write_straight_bundle(tmp_path / "straight"))
    yield played
    played.close()


def run(hub, tmp_path, name="hf://owner/name"):
    port = hub.server.server_address[1]
    state = {
        "HF_ENDPOINT": f"http://127.0.0.1:{port}",
        "HF_HOME": str(tmp_path / "cache"),
        "HF_HUB_DISABLE_XET": "1",
        "HF_HUB_ETAG_TIMEOUT": "300",
        "HF_HUB_DOWNLOAD_TIMEOUT": "300",
    }
    return subprocess.run(
        [*RUN, "--policy", name], env={**os.environ, **state}, capture_output=True, text=True, check=False
    )


def test_a_repository_is_fetched_once_and_read_from_the_cache_when_the_network_is_away(hub, tmp_path):
    (hub.folder / "README.md").write_text("what nobody asked for")
    done = run(hub, tmp_path)
    assert (done.returncode, "policy straight" in done.stdout) == (0, True), done.stderr
    assert any("policy.npz" in path for path in hub.asked)
    assert not any("resolve" in path and "README" in path for path in hub.asked)
    hub.close()
    again = run(hub, tmp_path)
    assert (again.returncode, "policy straight" in again.stdout) == (0, True), again.stderr


def test_what_was_changed_on_the_hub_is_refused(hub, tmp_path):
    (hub.folder / "policy.npz").write_bytes(b"changed")
    done = run(hub, tmp_path)
    assert done.returncode == 2
    assert "does not match its digest" in done.stderr and done.stderr.count("\n") == 1


def test_a_repository_that_is_not_there_is_one_line(hub, tmp_path):
    done = run(hub, tmp_path, "hf://owner/other")
    assert done.returncode == 2
    assert "edge-run: hf://owner/other: cannot be fetched" in done.stderr and done.stderr.count("\n") == 1


def test_a_file_that_nobody_would_read_is_not_fetched(hub, tmp_path):
    with (hub.folder / "policy.onnx").open("wb") as file:
        file.truncate(LARGEST_FILE + 1)
    done = run(hub, tmp_path)
    assert done.returncode == 2
    assert "policy.onnx has 32000001 bytes, at most 32000000 are read" in done.stderr
    assert not (tmp_path / "cache" / "hub").exists() or not list((tmp_path / "cache").rglob("policy.npz"))
