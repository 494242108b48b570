"""Requests to a rig with a client on its ports."""

import os
import struct
import time
from pathlib import Path

import pytest
import serial

import hilrig


def drive(wheels: serial.Serial, left: int, right: int) -> bytes:
    """Writes the two registers of the wheels; returns the slave's answer of 5 bytes."""
    frame = bytes([0xAB, 1, 0x82]) + struct.pack("bb", left, right)
    wheels.write(frame + struct.pack("<H", sum(frame)))
    return wheels.read(5)


def test_a_program_drives_waits_and_is_judged(scenario: Path) -> None:
    with hilrig.Rig(scenario, seed=7) as rig:
        assert rig.seed == 7
        assert set(rig.ports) == {"lidar", "lidar-motor", "wheels"}
        with serial.Serial(rig.port("wheels"), 115200, timeout=60) as wheels:
            # 0.2 m/s from x = 1. The wheels stop half a second after the last order, so a slow
            # program must repeat it.
            turns = {"axis": {"name": "left", "op": ">", "value": 0}}
            for _ in range(100):
                # The empty frame of register 1 with its sum 0xAB + 0x01 = 0x00AC.
                assert drive(wheels, 20, 20) == bytes([0xAB, 1, 0, 0xAC, 0])
                if rig.wait(turns, "100ms"):
                    break
            else:
                pytest.fail("the wheels never turned")
            state = rig.state()
            assert state["pose"]["y_m"] == pytest.approx(1.0, abs=0.05)
            assert not rig.wait({"visited": 1}, "100ms")
            live = rig.verdict()
            assert live.folder is None and live.checks
        result = rig.finish()
        # The waypoint is far away, and the robot did not drive there.
        # On a busy machine the run is not judged: the rig may have been too late for the program.
        assert not result and result.verdict in ("fail", "not-judged")
        assert [check.name for check in result.failures] == ["waypoints-visited"]
        assert (rig.out / "report.html").exists()
        with pytest.raises(AssertionError, match="waypoints-visited"):
            result.assert_passed()
        folder = rig.dir.parent
    assert not folder.exists()


def test_faults_come_and_go(scenario: Path) -> None:
    with hilrig.Rig(scenario) as rig:
        with serial.Serial(rig.port("wheels"), 115200, timeout=0.3) as wheels:
            with rig.fault("wheels", direction="to-device", kind="cut") as fault:
                assert fault.number == 0
                assert drive(wheels, 0, 0) == b""
            wheels.timeout = 60
            assert len(drive(wheels, 0, 0)) == 5
        with pytest.raises(hilrig.Refused, match='kind: is "nonsense", expected one of'):
            rig.fault("wheels", direction="to-device", kind="nonsense")
        with pytest.raises(KeyError, match="expected one of lidar"):
            rig.port("radio")


def standing(rig: hilrig.Rig) -> int:
    """The virtual time while paused: a late rig first catches up with its clock."""
    seen = -1
    while True:
        now = int(rig.state()["time_ns"])
        if now == seen:
            return now
        seen = now
        time.sleep(0.05)


def test_rig_time_stands_and_goes_in_steps(scenario: Path) -> None:
    with hilrig.Rig(scenario) as rig:
        rig.pause()
        before = standing(rig)
        rig.step("250ms")
        assert rig.state()["time_ns"] == before + 250_000_000
        rig.resume()


def test_a_scenario_that_is_wrong_is_an_error_with_its_words(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("schema = 1\nnam = 'x'\n")
    with pytest.raises(hilrig.RigError, match="nam"):
        hilrig.Rig(wrong)


def test_a_program_is_run_and_judged(scenario: Path, tmp_path: Path) -> None:
    program = 'python3 -c "import os; print(os.environ[\'HILRIG_SEED\'])"'
    result = hilrig.run(scenario, program, out=tmp_path / "out", seed=3, may_end=True)
    assert not result.passed
    assert "program-connected" in [check.name for check in result.failures]
    assert (tmp_path / "out" / "program.log").read_text().strip() == "3"


def test_firmware_that_is_missing_is_an_error_with_its_name(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(
        'schema = 1\nname = "bench"\nrobot = "none"\nduration = "1s"\n'
        'device.air = { description = "mh-z19" }\n'
    )
    wires = {"air": "serial1"}
    with pytest.raises(hilrig.RigError, match=r"missing\.elf"):
        hilrig.firmware(bench, "missing.elf", "arduino-mega", wires=wires, out=tmp_path / "out")


def test_the_binary_is_the_one_that_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HILRIG", "/nowhere/hilrig")
    assert hilrig.find_binary() == "/nowhere/hilrig"
    with pytest.raises(hilrig.RigError, match="cannot be started"):
        hilrig.Rig("x.toml")


def test_a_rig_ends_with_its_process(scenario: Path, places: Path) -> None:
    """A child process starts a rig, prints its directory, and is killed."""
    import signal
    import subprocess
    import sys

    child = "import hilrig, sys, time; r = hilrig.Rig(sys.argv[1]); "
    child += "print(r.dir, r._process.pid, flush=True); time.sleep(600)"
    environment = {**os.environ, "PYTHONPATH": str(Path(hilrig.__file__).parent.parent)}
    with subprocess.Popen(
        [sys.executable, "-c", child, str(scenario)],
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    ) as process:
        assert process.stdout is not None
        ports, pid = process.stdout.readline().split()
        assert (Path(ports) / "lidar").exists()
        process.send_signal(signal.SIGKILL)
    for _ in range(6_000):
        if not Path(ports, "lidar").exists() and not Path("/proc", pid).exists():
            return
        time.sleep(0.02)
    pytest.fail(f"{ports} or process {pid} is still there")
