"""The Debian package's scripts under dpkg itself: installed, upgraded and removed below a folder.

Their absolute paths are moved there; the interpreter, systemd and what makes users are stand-ins.
"""

import contextlib
import os
import re
import shutil
import subprocess

import pytest
from paths import ROOT

pytestmark = pytest.mark.skipif(shutil.which("dpkg-deb") is None, reason="dpkg is not installed")

PYTHON = """#!/bin/sh
# -m venv --clear FOLDER
rm -rf "$4"
[ ! -e ROOT/broken ] || exit 1
mkdir -p "$4/bin"
printf '#!/bin/sh\\nexit 0\\n' >"$4/bin/pip"
echo read line >"$4/bin/edge-run"
chmod 755 "$4/bin/pip"
"""
STAND_INS = {
    "systemctl": 'echo "$@" >>ROOT/systemctl.log; [ ! -e ROOT/broken ]',
    "id": "false",
    "useradd": ":",
    "install": "mkdir -p ROOT/var/lib/cfpg-edge ROOT/var/log/cfpg-edge",
    "ldconfig": ":",
    "start-stop-daemon": ":",
}
LINK = "etc/systemd/system/multi-user.target.wants/edge-run@2.service"
ARGUMENTS = {
    "preinst": ["install", "install 1.0", "upgrade 1.0", "abort-upgrade 2.0"],
    "prerm": ["remove", "upgrade 2.0", "failed-upgrade 1.0", "remove in-favour x 1",
              "deconfigure in-favour x 1"],
    "postinst": ["configure", "configure 1.0", "abort-upgrade 2.0", "abort-remove",
                 "abort-remove in-favour x 1", "abort-deconfigure in-favour x 1"],
    "postrm": ["remove", "purge", "upgrade 2.0", "failed-upgrade 1.0", "abort-install", "abort-install 1.0",
               "abort-upgrade 1.0", "disappear x 1"],
}  # fmt: skip
"""Whatever dpkg may call them with (Debian policy, chapter 6)."""


PATHS = re.compile(r"(?<![\w/])/(?=(?:opt|var|run|etc|usr/lib|usr/bin)/)")


class Machine:
    """A root of its own, with packages of two versions to install."""

    def __init__(self, root):
        self.root, self.tools = root, root / "tools"
        for path in (self.tools, root / "run/systemd/system", root / "usr/bin", (root / LINK).parent):
            path.mkdir(parents=True)
        for name, script in STAND_INS.items():
            self._write(self.tools / name, f"#!/bin/sh\n{script}\n")
        self._write(root / "usr/bin/python3", PYTHON)
        (root / "var/lib/dpkg/updates").mkdir(parents=True)
        for name in ("status", "available"):
            (root / "var/lib/dpkg" / name).touch()
        self.packages = {version: self._package(version) for version in ("1.0", "2.0")}

    def _write(self, path, script):
        path.write_text(script.replace("ROOT", str(self.root)))
        path.chmod(0o755)

    def _package(self, version):
        folder = self.root / f"package-{version}"
        control = folder / "DEBIAN"
        control.mkdir(parents=True)
        (folder / "etc/cfpg-edge").mkdir(parents=True)
        (folder / "etc/cfpg-edge/environment").write_text("# flags\n")
        (control / "conffiles").write_text("/etc/cfpg-edge/environment\n")
        (control / "control").write_text(
            f"Package: cfpg-edge\nVersion: {version}\nArchitecture: all\n"
            "Maintainer: x <x@y.z>\nDescription: x\n"
        )
        subprocess.run(["sh", ROOT / "packaging/debian/scripts.sh", version, control], check=True)
        for name in ARGUMENTS:
            moved, count = PATHS.subn(f"{self.root}/", (control / name).read_text())
            assert count
            self._write(control / name, moved)
        subprocess.run(["dpkg-deb", "--build", folder, self.root], check=True, capture_output=True)
        return self.root / f"cfpg-edge_{version}_all.deb"

    def dpkg(self, *arguments):
        """Its exit code and what it and the scripts complained of."""
        flags = [
            f"--instdir={self.root}",
            f"--admindir={self.root}/var/lib/dpkg",
            f"--log={self.root}/dpkg.log",
        ]
        flags += ["--force-script-chrootless", "--force-not-root", "--force-depends", "--force-bad-path"]
        done = self._run("dpkg", *flags, *arguments)
        return done.returncode, done.stderr

    def script(self, name, arguments):
        return self._run(self.root / "package-1.0/DEBIAN" / name, *arguments.split()).returncode

    def _run(self, *command):
        path = os.pathsep.join([str(self.tools), os.environ["PATH"], "/usr/sbin", "/sbin"])
        environment = {**os.environ, "PATH": path, "LC_ALL": "C"}
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)

    def state(self):
        """Version and state, as dpkg tells them."""
        shown = ["-W", "-f=${Version} ${db:Status-Status}", "cfpg-edge"]
        return self._run("dpkg-query", f"--admindir={self.root}/var/lib/dpkg", *shown).stdout

    @property
    def environment(self):
        return self.root / "opt/cfpg-edge"

    @contextlib.contextmanager
    def robot(self):
        """Drive: a process as the unit, or a person, starts it."""
        run = self.environment / "bin/edge-run"
        command = [str(run.with_name("python3")), "./edge-run", "--robot-id", "2"]
        with subprocess.Popen(
            command, executable="/bin/sh", stdin=subprocess.PIPE, cwd=run.parent
        ) as process:
            yield process
            process.stdin.close()


@pytest.fixture
def machine(tmp_path):
    made = Machine(tmp_path)
    assert made.dpkg("-i", made.packages["1.0"])[0] == 0
    assert made.state() == "1.0 installed"
    (made.root / LINK).touch()
    return made


STEPS = ["-r cfpg-edge", "-P cfpg-edge", "-i 2.0", "-i 1.0", "--unpack 2.0"]


@pytest.mark.parametrize("step", STEPS)
def test_under_a_robot_that_drives_nothing_is_changed(machine, step):
    step = [machine.packages.get(word, word) for word in step.split()]
    with machine.robot() as process:
        code, said = machine.dpkg(*step)
        assert code != 0
        assert f"it is running here, process {process.pid}; stop it first: systemctl stop" in said
        assert machine.state() == "1.0 installed"
        assert (machine.environment / "bin/edge-run").exists()
        assert process.poll() is None
    assert machine.dpkg(*step)[0] == 0


def test_a_robot_that_starts_between_two_steps_keeps_what_it_drives_with(machine):
    assert machine.dpkg("--unpack", machine.packages["2.0"])[0] == 0
    (machine.environment / "old").touch()
    with machine.robot():
        code, said = machine.dpkg("--configure", "cfpg-edge")
        assert code != 0
        assert "it is running here" in said
        assert (machine.environment / "old").exists()
    assert machine.dpkg("--configure", "-a")[0] == 0
    assert machine.state() == "2.0 installed"
    assert not (machine.environment / "old").exists()


def test_an_upgrade_removal_and_purge_leave_what_the_manual_says(machine):
    assert machine.dpkg("-i", machine.packages["2.0"])[0] == 0
    assert machine.state() == "2.0 installed"
    (machine.root / "etc/cfpg-edge/team.key").touch()
    assert machine.dpkg("-r", "cfpg-edge")[0] == 0
    assert not machine.environment.exists()
    assert (machine.root / "etc/cfpg-edge/environment").exists()
    assert (machine.root / LINK).exists()
    machine.environment.mkdir()  # from wheels, since
    assert machine.dpkg("-P", "cfpg-edge")[0] == 0
    assert machine.environment.exists()
    assert not (machine.root / "etc/cfpg-edge/environment").exists()
    assert not (machine.root / LINK).exists()
    assert (machine.root / "etc/cfpg-edge/team.key").exists()
    assert (machine.root / "var/log/cfpg-edge").exists()


def test_what_failed_half_way_is_done_again(machine):
    (machine.root / "broken").touch()
    assert machine.dpkg("-i", machine.packages["2.0"])[0] != 0
    assert machine.state() == "2.0 half-configured"
    (machine.root / "broken").unlink()
    assert machine.dpkg("--configure", "-a")[0] == 0
    assert machine.state() == "2.0 installed"
    assert (machine.environment / "bin/edge-run").exists()


def test_a_systemd_that_refuses_leaves_nothing_half_removed(machine):
    (machine.root / "broken").touch()
    assert machine.dpkg("-P", "cfpg-edge")[0] == 0
    assert (machine.root / "systemctl.log").read_text().count("daemon-reload") >= 2


@pytest.mark.parametrize("name", ARGUMENTS)
def test_every_script_takes_every_argument_again_and_again(machine, name):
    for arguments in ARGUMENTS[name]:
        assert [machine.script(name, arguments) for _ in range(2)] == [0, 0], arguments


def test_what_undoes_a_step_is_done_under_a_robot_too(machine):
    with machine.robot():
        for name in ("preinst", "prerm", "postinst"):
            codes = {arguments: machine.script(name, arguments) for arguments in ARGUMENTS[name]}
            assert codes == {each: int(not each.startswith("abort-")) for each in codes}
        assert (machine.environment / "bin/edge-run").exists()
