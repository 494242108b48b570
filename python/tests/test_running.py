"""Faults and waits while a program runs, and rigs with one device."""

import asyncio
import tempfile
import threading
import time
from pathlib import Path

import pytest

import hilrig
import hilrig.aio
from hilrig.control import Control

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


def test_a_fault_may_outlive_its_rig() -> None:
    """``finish``, ``close``, another client, and a kill end the rig within the block."""
    ends = [
        lambda rig: rig.finish(),
        lambda rig: rig.close(),
        lambda rig: Control(rig.dir).ask("quit"),
        lambda rig: rig._process.kill(),
    ]
    for end in ends:
        with hilrig.Bench("modbus-meter") as meter:
            with meter.faulty("wrong-current"):
                end(meter)
            with pytest.raises(ConnectionError, match="(?s)^the rig has ended.(the rig's|hilrig)"):
                meter.state()
    # A request that the rig refuses is still an error.
    with hilrig.Bench("modbus-meter") as meter:
        with pytest.raises(hilrig.Refused, match="id"):
            with meter.faulty("wrong-current") as fault:
                fault.number = 7


def test_a_rig_that_cannot_begin_leaves_no_directory(tmp_path: Path, monkeypatch) -> None:
    old = tmp_path / "hilrig-old"
    old.write_text("#!/bin/sh\nexit 1\n")
    old.chmod(0o755)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    settings = {"binary": str(old), "virtual": True}
    robot = CONNECT / "robot.toml"
    for start in [
        lambda: hilrig.Rig(robot, **settings),
        lambda: hilrig.Running(robot, "true", **settings),
        lambda: hilrig.Bench("modbus-meter", **settings),
        lambda: hilrig.Rig(robot, binary=str(old)),
        lambda: hilrig.Rig(robot, binary=str(tmp_path / "none")),
        lambda: hilrig.Rig(None),
    ]:
        with pytest.raises((hilrig.RigError, TypeError)):
            start()
        assert list(tmp_path.iterdir()) == [old]


async def waits_at_once() -> None:
    relay = {"register": {"device": "modbus-meter", "name": "relay", "value": False}}
    keys = {"device": "modbus-meter", "kind": "device", "fault": "wrong-current"}
    async with hilrig.aio.device("modbus-meter") as meter:
        # More than the default executor has threads.
        waiting = [asyncio.create_task(meter.wait(relay, "600s")) for _ in range(40)]
        async with meter.fault(**keys) as number:
            assert number == 0
        assert not any(one.done() for one in waiting)
        for one in waiting:
            one.cancel()
        await asyncio.wait(waiting)
        assert not await meter.wait(relay, "10ms")
        async with meter.fault(**keys):
            assert (await meter.finish()).checks
        with pytest.raises(ConnectionError, match="(?s)^the rig has ended.the rig's verdict"):
            await meter.state()


def test_asyncio_waits_and_adds_a_fault_at_the_same_time() -> None:
    asyncio.run(waits_at_once())


class Stub:
    """A rig whose start and ``finish`` wait for the test."""

    def __init__(self) -> None:
        self.begun, self.go, self.is_closed = threading.Event(), threading.Event(), False

    def start(self) -> "Stub":
        self.finish()
        return self

    def finish(self) -> None:
        self.begun.set()
        assert self.go.wait(60)

    def _hang_up(self) -> None:
        self.go.set()

    def close(self) -> None:
        self.is_closed = True


async def cancelled(stub: Stub, body) -> None:
    """Cancels ``body`` while the stub waits."""
    task = asyncio.create_task(body())
    while not stub.begun.is_set():
        await asyncio.sleep(0.001)
    task.cancel()
    # Runs after the cancellation.
    asyncio.get_running_loop().call_later(0.01, stub.go.set)
    with pytest.raises(asyncio.CancelledError):
        await task
    assert stub.is_closed


def test_a_cancelled_start_closes_its_rig() -> None:
    stub = Stub()

    async def body() -> None:
        async with hilrig.aio._started(stub.start):
            pytest.fail("it was cancelled")

    asyncio.run(cancelled(stub, body))


def test_a_cancelled_finish_closes_its_rig() -> None:
    stub = Stub()

    async def body() -> None:
        async with hilrig.aio._started(lambda: stub) as rig:
            await rig.finish()

    asyncio.run(cancelled(stub, body))


def test_a_finish_in_another_thread_is_ended(tmp_path: Path) -> None:
    with hilrig.Running(CONNECT / "robot.toml", "exec sleep 600", out=tmp_path / "out") as rig:
        rig._hang_up()
        assert rig.finish().verdict != "pass"
