"""The plugin as a user sees it: runs pytest on tests with the fixture."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from conftest import SOURCE
from hilrig import RigError
from hilrig.plugin import RigFactory

TWENTY = """
import pytest, serial

@pytest.mark.parametrize("number", range(20))
@pytest.mark.hilrig("robot.toml")
def test_one(rig, number):
    r = rig(seed=number)
    with serial.Serial(r.port("lidar"), 115200, timeout=60) as lidar:
        assert len(lidar.read(1)) == 1
    with r.fault("lidar", direction="to-master", kind="cut"):
        assert r.state()["time_ns"] > 0
    assert r.seed == number
    assert r.finish().raw["result"]["used"] == ["lidar"]
"""


def test_twenty_in_parallel_do_not_meet(inner, places) -> None:
    result = inner(TWENTY, "-n", "4")
    result.assert_outcomes(passed=20)
    assert list(places.glob("hilrig-*")) == []


FAILING = """
import pytest

@pytest.mark.hilrig("robot.toml", seed=5)
def test_nobody_drives(rig):
    assert rig().verdict().passed

@pytest.mark.hilrig("robot.toml", options=["--until-over"])
def test_that_passes(rig):
    assert rig().state()["paused"] is False

def test_without_a_rig(rig):
    pass
"""


TWO_ARGUMENTS = """
import pytest

@pytest.mark.hilrig("robot.toml", 5)
def test_it_starts(rig):
    rig()
"""


def test_a_marker_with_a_second_argument_is_refused(inner) -> None:
    result = inner(TWO_ARGUMENTS)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*@pytest.mark.hilrig has 5 behind its scenario*seed=5*"])


def test_a_failing_test_keeps_its_folder_and_says_how_to_repeat_it(inner, pytester) -> None:
    result = inner(FAILING)
    result.assert_outcomes(passed=2, failed=1)
    said = result.stdout.str()
    kept = re.search(r"^results: (.*)$", said, re.M)
    assert kept, said
    folder = Path(kept[1])
    assert folder.parent == pytester.path / "hilrig-out" / "pytest"
    assert folder.name.startswith("test_inner.py-test_nobody_drives-")
    names = {path.name for path in folder.iterdir()}
    assert {"report.html", "capture.pcapng", "result.json", "hilrig.log"} <= names
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]
    # The command repeats the test from any directory.
    command = re.search(r"^repeat with: (.*)$", said, re.M)
    assert command and "--hilrig-seed 5" in command[1], said
    again = command[1].replace("python -m pytest", f"{sys.executable} -m pytest -p hilrig.plugin")
    shown = subprocess.run(["sh", "-c", again], cwd="/", capture_output=True, text=True)
    assert shown.returncode == 1 and "1 failed" in shown.stdout, shown.stdout


WITHIN = """
import pytest
from hilrig.control import Control

@pytest.mark.hilrig("robot.toml")
def test_running(rig):
    with rig():
        assert False

@pytest.mark.hilrig("robot.toml")
def test_ended(rig):
    with rig.start("exit 3") as r:
        r.wait({"visited": 1}, "60s")

@pytest.mark.hilrig("robot.toml")
def test_ended_unseen(rig):
    with rig() as r:
        Control(r.dir).ask("quit")
        r._process.wait()
        assert False

@pytest.mark.hilrig("robot.toml")
def test_killed(rig):
    with rig() as r:
        r._process.kill()
        r.state()
"""


def test_a_test_that_fails_within_its_rig_is_one_failure_and_keeps_the_log(
    inner, pytester, places
) -> None:
    result = inner(WITHIN)
    result.assert_outcomes(failed=4)
    kept = pytester.path / "hilrig-out" / "pytest"
    assert len(list(kept.iterdir())) == 4
    for folder in kept.iterdir():
        assert (folder / "hilrig.log").is_file(), folder
    assert list(places.glob("hilrig-*")) == []
    # The request that fails tells how the program ended.
    said = result.stdout.str()
    assert re.search(r"the r(un|ig) has ended\n.*exit code 3", said, re.S), said


def test_a_rig_that_cannot_be_closed_does_not_keep_the_others_open(request) -> None:
    class Stub:
        def __init__(self, error=None) -> None:
            self.error, self.calls = error, []

        def keep_log(self) -> None:
            self.call("keep_log")

        def close(self) -> None:
            self.call("close")

        def call(self, name) -> None:
            self.calls.append(name)
            if self.error is not None:
                raise self.error

    for error in (RigError("stuck"), ValueError("closed"), OSError("full")):
        factory = RigFactory(request)
        factory._rigs = [Stub(error), Stub()]
        with pytest.raises(RigError, match=str(error)):
            factory.close(failed=True)
        assert [rig.calls for rig in factory._rigs] == [["keep_log", "close"]] * 2


JUDGED = """
def test_the_program_is_judged(rig):
    result = rig.run("exec sleep 600", "robot.toml", options=["--exec-wait", "1s"])
    result.assert_passed()
"""


def test_a_judged_program_that_fails_keeps_its_folder_too(inner) -> None:
    result = inner(JUDGED)
    result.assert_outcomes(failed=1)
    said = result.stdout.str()
    assert "program-connected" in said
    kept = re.search(r"^results: (.*)$", said, re.M)
    assert kept and (Path(kept[1]) / "program.log").exists(), said


def test_virtual_time_is_refused_by_a_command_that_has_none(inner, tmp_path, monkeypatch) -> None:
    old = tmp_path / "hilrig-old"
    old.write_text("#!/bin/sh\necho 'hilrig 0.0.1 (old)'\n")
    old.chmod(0o755)
    monkeypatch.setenv("HILRIG", str(old))
    result = inner(FAILING, "--hilrig-virtual")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    told = result.stderr.str() + result.stdout.str()
    assert "hilrig 0.0.1 (old)) has no --virtual" in told


VIRTUAL = """
import pytest

@pytest.mark.hilrig("robot.toml")
def test_a_program(rig):
    result = rig.run("python3 reader.py", options=["--exec-may-end"])
    # The calendar of virtual time begins in 2026; its clocks are the same in each run.
    assert (result.folder / "program.log").read_text().startswith("17672256")

@pytest.mark.hilrig("robot.toml")
def test_that_is_the_program(rig):
    assert rig().state()["paused"] is False
"""
READER = """
import os, time
port = os.open(os.environ["HILRIG_PORT_LIDAR"], os.O_RDWR | os.O_NOCTTY)
os.read(port, 22)
print(time.time())
"""


def test_the_option_runs_programs_in_virtual_time(inner, pytester) -> None:
    (pytester.path / "reader.py").write_text(READER)
    inner(VIRTUAL, "--hilrig-virtual").assert_outcomes(passed=2)


SLOW = """
import time, pytest

@pytest.mark.parametrize("number", range(4))
@pytest.mark.hilrig("robot.toml")
def test_slow(rig, number, request):
    r = rig()
    pids = request.config.rootpath / "pids"
    pids.mkdir(exist_ok=True)
    (pids / str(r._process.pid)).write_text(str(r.dir))
    time.sleep(600)
"""


def test_a_killed_pytest_leaves_no_process_and_no_port(inner, pytester, places) -> None:
    pytester.makepyfile(test_inner=SLOW)
    words = [sys.executable, "-m", "pytest", "-p", "hilrig.plugin", "-n", "4"]
    environment = {**os.environ, "PYTHONPATH": str(SOURCE)}
    process = subprocess.Popen(
        words, cwd=pytester.path, env=environment, stdout=subprocess.DEVNULL, start_new_session=True
    )
    pids = pytester.path / "pids"
    try:
        wait_until(lambda: pids.is_dir() and len(list(pids.iterdir())) == 4)
        ports = [Path(path.read_text()) for path in pids.iterdir()]
        assert all((path / "lidar").exists() for path in ports)
    finally:
        # Kills pytest and its workers at once, so that no process can clean up.
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    rigs = [Path("/proc", path.name) for path in pids.iterdir()]
    wait_until(lambda: not any(path.exists() for path in [*rigs, *ports]))


def wait_until(holds, patience_s: float = 120.0) -> None:
    deadline = time.monotonic() + patience_s
    while not holds():
        assert time.monotonic() < deadline, "it never came true"
        time.sleep(0.02)


MARKED = """
import pytest

class Stub:
    seed = 1
    def __init__(self, path, out, virtual): self.virtual = virtual
    def close(self): pass

@pytest.fixture(autouse=True)
def stub(monkeypatch):
    monkeypatch.setattr("hilrig.plugin.Rig", Stub)

@pytest.mark.hilrig("robot.toml", virtual=True)
def test_marked(rig):
    assert rig().virtual is True
    assert rig(virtual=False).virtual is False

@pytest.mark.hilrig("robot.toml")
def test_plain(rig):
    assert rig().virtual is False
    assert rig(virtual=True).virtual is True
"""


def test_the_marker_makes_a_rig_virtual_and_the_option_does_not(inner) -> None:
    inner(MARKED, "--hilrig-virtual").assert_outcomes(passed=2)
