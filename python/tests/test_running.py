"""Faults and waits while a program runs, and rigs with one device."""

import asyncio
import time
from pathlib import Path

import pytest

import hilrig
import hilrig.aio

CONNECT = Path(__file__).parent.parent.parent / "docs" / "connect"
MOVES = {"robot": {"of": "speed-m-s", "op": ">", "value": 0.1}}
STANDS = {"robot": {"of": "speed-m-s", "op": "<", "value": 0.01}}


def cut_lidar(out: Path, pause_s: float):
    """Cuts the lidar of a driving robot; a slow test changes nothing."""
    program = f"python3 {CONNECT / 'robot.py'}"
    with hilrig.Running(CONNECT / "robot.toml", program, out=out, virtual=True) as rig:
        assert rig.wait(MOVES, "5s")
        at = rig.state()["time_ns"]
        time.sleep(pause_s)
        assert rig.state()["time_ns"] == at
        with rig.fault("lidar", direction="to-master", kind="cut"):
            assert rig.wait(STANDS, "2s")
            stood = rig.state()["time_ns"]
        result = rig.quit()
        assert rig.finish() is result
    case = (out / "case.toml").read_text()
    return at, stood, result.raw["result"]["runs"][0]["trace_hash"], case.count('kind = "cut"')


def test_a_fault_begins_at_the_same_nanosecond_in_each_run(tmp_path: Path) -> None:
    first = cut_lidar(tmp_path / "first", 0.0)
    assert cut_lidar(tmp_path / "second", 0.3) == first
    assert first[3] == 1
    # The watchdog of the wheels: half a second after the last order.
    assert 0.4e9 < first[1] - first[0] < 1.0e9


def test_a_program_that_ends_ends_the_wait(tmp_path: Path) -> None:
    running = hilrig.Running(CONNECT / "robot.toml", "exit 3", out=tmp_path / "out", virtual=True)
    with running as rig:
        with pytest.raises((hilrig.Refused, ConnectionError), match="the r(un|ig) has ended"):
            rig.wait({"visited": 1}, "60s")
        assert "exit code 3" in str(rig.finish())


def test_a_program_in_real_time_is_ended_at_once(tmp_path: Path) -> None:
    program = f"python3 {CONNECT / 'robot.py'}"
    with hilrig.Running(CONNECT / "robot.toml", program, out=tmp_path / "out") as rig:
        assert rig.wait({"bytes": {"link": "wheels", "direction": "to-device", "count": 1}}, "20s")
        result = rig.quit()
    assert "program-connected" in [check.name for check in result.checks]
    assert (tmp_path / "out" / "report.html").exists()


def test_a_device_has_values_and_faults() -> None:
    with hilrig.Bench("modbus-meter", settings={"address": 2}) as meter:
        assert Path(meter.path).exists() and meter.value("relay") is True
        assert meter.value("voltage") == pytest.approx(230, abs=5)
        with meter.faulty("wrong-current") as fault:
            assert fault.number == 0
        assert meter.wait_for("relay", True, "1s") and not meter.wait_for("relay", False, "10ms")
        with pytest.raises(KeyError, match="no value 'volt', expected one of load, relay, voltage"):
            meter.value("volt")
    with pytest.raises(hilrig.RigError, match="no-such-meter"):
        hilrig.Bench("no-such-meter")


def test_a_program_plays_the_device() -> None:
    scale = Path(__file__).parent.parent.parent / "nodes" / "examples" / "scale.py"
    settings = {"load_g": 100.25}
    with hilrig.Bench(exec=f"python3 {scale}", rate=9600, settings=settings, name="scale") as bench:
        assert list(bench.ports) == ["scale"]
        with bench.faulty("draught"):
            assert bench.state()["time_ns"] > 0


async def waits_at_once() -> None:
    async with hilrig.aio.device("modbus-meter") as meter:
        relay = {"device": "modbus-meter", "name": "relay", "value": False}
        waiting = asyncio.create_task(meter.wait({"register": relay}, "300ms"))
        keys = {"device": "modbus-meter", "kind": "device", "fault": "wrong-current"}
        async with meter.fault(**keys) as number:
            assert number == 0
        assert not waiting.done()
        assert await waiting is False
        assert (await meter.state())["time_ns"] >= 300_000_000
        assert (await meter.finish()).checks


def test_asyncio_waits_and_adds_a_fault_at_the_same_time() -> None:
    asyncio.run(waits_at_once())
