"""The bridges without a rig and without ROS: the robot of a scenario, its lidar, its commands."""

import json
import math
import os
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import SOURCE

if sys.version_info < (3, 11):
    pytest.skip("a bridge needs tomllib", allow_module_level=True)

from hilrig.bridges import robot
from hilrig.bridges.model import Lidar, Model, ModelError
from hilrig.bridges.robot import Driver, Robot, Sink, Turn

CUSTOM = Path(__file__).parent.parent.parent / "scenarios" / "custom-robot.toml"
TEXT = CUSTOM.read_text(encoding="utf-8")
LIDAR, BASE = "[device.lidar.xv11]\n", "[device.wheels.registers]\n"
#: A turn at 300 rpm, and the time of a packet.
TURN_S = 0.2
PACKET_S = TURN_S / 90


def model(*changes):
    """The robot of scenarios/custom-robot.toml with some texts replaced."""
    import tomllib

    text = TEXT
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return Model.of(tomllib.loads(text), "s.toml")


def encoder_rows(text=TEXT):
    """The rows of the encoders, to be removed."""
    return text[text.index("[[device.wheels.registers.register]]\naddress = 4") :].split("[world]")[0]


def packet(index, range_mm=None, rpm=300):
    """A packet by the layout of the sensor; only its first reading has an echo at ``range_mm``."""
    readings = struct.pack("<BBH", 0, 0x80, 0) * 4
    if range_mm is not None:
        readings = struct.pack("<HH", range_mm, 100) + readings[4:]
    body = struct.pack("<BBH", 0xFA, 0xA0 + index, rpm * 64) + readings
    total = 0
    for word in struct.unpack("<10H", body):
        total = (total << 1) + word
    return body + struct.pack("<H", (total & 0x7FFF) + (total >> 15) & 0x7FFF)


# The robot of a scenario.


def test_the_robot_of_the_shipped_scenario_has_no_notes() -> None:
    found = model()
    assert found.notes == () and set(found.base.encoders) == {"left", "right"}
    assert found.lidar.x_m == 0.05 and not found.base.is_high_first


def test_the_named_sources_are_encoders_too() -> None:
    sources = [
        (f'source = {{ encoder = "{one}" }}', f'source = "encoder-{one}"') for one in ("left", "right")
    ]
    assert model(*sources) == model()


def test_the_checksum_has_the_order_of_the_scenario() -> None:
    found = model((BASE, BASE + 'checksum = "high-first"\n'))
    driver = Driver(found.base)
    driver.drive({"left": 0.2, "right": 0.2})
    # 0xAB + 1 + 0x82 + 20 + 20 = 0x0156, as the frame of docs/python.md with the other order.
    assert driver.next_frame(0.0) == bytes([0xAB, 1, 0x82, 20, 20, 0x01, 0x56])
    assert driver.feed(bytes([0xAB, 1, 0, 0x00, 0xAC])) == [(1, b"")]
    # 0xAB + 4 + 8 = 0xB7: both encoders in one request.
    assert driver.next_frame(0.1) == bytes([0xAB, 4, 8, 0x00, 0xB7])
    low = Driver(model().base)
    low.drive({"left": 0.2, "right": 0.2})
    assert low.next_frame(0.0) == bytes([0xAB, 1, 0x82, 20, 20, 0x56, 0x01])
    assert low.feed(bytes([0xAB, 1, 0, 0x00, 0xAC])) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("[chassis.differential]", "[chassis.ackermann]"), "s.toml: chassis.ackermann: is a car"),
        ((LIDAR, LIDAR + 'profile = "fw2.1"\n'), 's.toml: device.lidar.xv11.profile: is "fw2.1"'),
        ((LIDAR, LIDAR + "supply = { host-v = 5 }\n"), "s.toml: device.lidar.xv11.supply: is the host"),
        (("address = 1\n", ""), "s.toml: KeyError.'address'., expected a scenario that hilrig runs"),
        (('width = "i8"', 'width = "i9"'), "s.toml: KeyError.'i9'."),
    ],
)
def test_what_a_bridge_cannot_do_is_an_error_with_file_and_key(change, said) -> None:
    with pytest.raises(ModelError, match=said):
        model(change)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([(encoder_rows(), "")], "s.toml: device.wheels: has no registers with source"),
        ([("encoder-right", "other"), ('{ encoder = "right" }', '"stored"')], "/odom assumes that"),
        ([("speed_m_s = 0.01", "power = 1.0")], "device.wheels: has no registers with drives"),
        ([("device.wheels.registers", "device.x.text")], "s.toml: device: has no registers with drives"),
        ([(LIDAR, LIDAR.replace("xv11", "a"))], "s.toml: device: has no xv11, so there is no /scan"),
        ([(LIDAR, "[device.b.xv11]\n" + LIDAR)], "device.lidar: is not used"),
    ],
)
def test_what_a_bridge_leaves_out_is_a_line_of_the_log(changes, said) -> None:
    [note] = model(*changes).notes
    assert said in note


# The lidar.


def bearing_deg(lidar, index):
    """Where the emulator of the lidar aims at reading ``index``, to the robot's left from ahead: its
    own angle 90 is ahead, and ``index0_deg`` is counter-clockwise in both directions."""
    turned = -index if lidar.is_clockwise else index
    return math.degrees(lidar.heading_rad + lidar.index0_rad) - 90 + turned


@pytest.mark.parametrize("is_clockwise", [False, True])
@pytest.mark.parametrize("index0_deg", [0.0, -10.0, 25.0])
def test_a_reading_has_the_angle_of_its_beam(is_clockwise, index0_deg) -> None:
    keys = f"index0_deg = {index0_deg}\n" + ('direction = "clockwise"\n' if is_clockwise else "")
    lidar = model((LIDAR, LIDAR + keys)).lidar
    turn = Turn(lidar)
    for number in range(91):
        scans = turn.feed(packet(number % 90, 1500 if number == 20 else None), number * PACKET_S)
    [scan] = scans
    [echo] = [index for index, range_m in enumerate(scan.ranges) if range_m == 1.5]
    angle = lidar.heading_rad + scan.angle_min + echo * scan.angle_increment
    assert math.degrees(angle) == pytest.approx(bearing_deg(lidar, 80))


def scans_of(lost, turns=4, twice=()):
    """The scans of some turns whose packets ``lost`` do not arrive, by their number from the start."""
    turn, scans = Turn(Lidar("lidar")), []
    for number in range(90 * turns + 1):
        for _ in range((number not in lost) + (number in twice)):
            # Each reading tells its turn.
            scans += turn.feed(packet(number % 90, 1000 + number // 90), number * PACKET_S)
    return scans


@pytest.mark.parametrize(
    ("name", "lost", "starts"),
    [
        ("none", (), [0, 1, 2, 3]),
        ("the first packet", {90}, [0, 1, 2, 3]),
        ("the first 30 packets", set(range(90, 120)), [0, 1, 2, 3]),
        ("the end and the beginning", set(range(150, 200)), [0, 1, 2, 3]),
        ("each first packet", {90, 180, 270}, [0, 1, 2, 3]),
        ("all but one packet of a turn", set(range(90, 179)), [0, 1, 2, 3]),
        ("a whole turn, to a later packet", set(range(100, 200)), [0, 1, 2, 3]),
        ("a turn", set(range(90, 180)), [0, 2, 3]),
        ("a turn and a half, to a later packet", set(range(85, 268)), [0, 2, 3]),
        ("the beginning of the run", set(range(30)), [1, 2, 3]),
    ],
)
def test_a_scan_has_the_readings_of_one_turn(name, lost, starts) -> None:
    """Packet 0 of turn n arrives after n turns, or would arrive then if it is lost."""
    scans = scans_of(lost)
    assert [scan.at_s for scan in scans] == pytest.approx([start * TURN_S for start in starts])
    for scan, start in zip(scans, starts):
        assert scan.turn_s == pytest.approx(TURN_S)
        finite = {range_m for range_m in scan.ranges if math.isfinite(range_m)}
        assert finite == {1 + start / 1000}, name
        arrived = sum(number not in lost for number in range(90 * start, 90 * start + 90))
        assert sum(map(math.isfinite, scan.ranges)) == arrived


def test_a_packet_that_comes_twice_divides_no_turn() -> None:
    assert scans_of((), twice={0, 45, 89, 90}) == scans_of(())


# Velocity commands.


class Commands(Sink):
    """Gives the commands of the test, and keeps the odometry."""

    def __init__(self) -> None:
        self.latest, self.speeds, self.number = None, [], 0

    def give(self, speed, turn=0.0):
        self.number += 1
        self.latest = (self.number, speed, turn)

    def command(self):
        return self.latest

    def odometry(self, odometry):
        self.speeds.append(odometry.speed_m_s)


@pytest.mark.parametrize("bad", [(math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0), (0.0, -math.inf)])
def test_a_command_that_is_no_number_is_ignored_with_a_line(bad, capsys) -> None:
    sink = Commands()
    hello = {"name": "r", "role": "robot", "seed": 1, "ports": [{"name": "lidar"}, {"name": "wheels"}]}
    one = Robot({**hello, "quantities": [], "settings": {}}, model((encoder_rows(), "")), sink)
    one.start()
    sink.give(0.2)
    assert one._wanted(1.0) == (0.2, 0.0)
    sink.give(*bad)
    # The command before holds until it is too old.
    assert [one._wanted(now) for now in (1.1, 1.5, 1.6)] == [(0.2, 0.0), (0.2, 0.0), (0.0, 0.0)]
    assert capsys.readouterr().err.count("ignored, expected finite values") == 1
    sink.give(0.1, 0.3)
    assert one._wanted(1.7) == (0.1, 0.3)


def test_a_speed_beyond_the_registers_is_the_fastest_one_in_the_odometry_too() -> None:
    found = model((encoder_rows(), ""))
    for speed, count in [(1e308, 30), (-1e308, -30), (math.inf, 30), (0.304, 30), (0.1, 10)]:
        register = found.base.set_points["left"]
        assert register.counts(speed) == struct.pack("b", count)
        assert register.reached(speed) == pytest.approx(count / 100)
    assert Driver(found.base).reached({"left": 9.0, "right": -0.1}) == pytest.approx(
        {"left": 0.3, "right": -0.1}
    )


FAILING = """
import sys, threading
from hilrig.bridges.robot import Sink, main

class Failing(Sink):
    def __init__(self, arguments):
        # As a library may have one.
        threading.Thread(target=threading.Event().wait).start()

    def clock(self, now_s):
        %s

    def end(self):
        print("ended", file=sys.stderr)

main("a bridge", Failing)
"""


@pytest.mark.parametrize(
    ("body", "code", "said"),
    [
        ("return None", 0, "ended"),
        ("raise ValueError('no clock')", 1, "ValueError: no clock\nended"),
        ("sys.exit('no master')", 1, "no master\nended"),
    ],
)
def test_a_bridge_ends_with_its_run_whatever_its_library_does(body, code, said) -> None:
    hello = {"hilrig_node": 1, "name": "r", "role": "robot", "seed": 7, "quantities": [], "settings": {}}
    hello["ports"] = [{"name": "lidar"}, {"name": "wheels"}]
    requests = [{"hello": hello}, {"exchange": {"now": 0, "items": []}}]
    process = subprocess.run(
        [sys.executable, "-c", FAILING % body, str(CUSTOM)],
        input="".join(json.dumps(one) + "\n" for one in requests),
        env={**os.environ, "PYTHONPATH": str(SOURCE)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert process.returncode == code, process.stderr
    assert process.stderr.strip().endswith(said), process.stderr
