"""A robot's program for bridges: reads the lidar and the wheels, and obeys velocity commands."""

from __future__ import annotations

import argparse
import math
import os
import struct
import sys
import traceback
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Optional, Tuple

from ..device import Device
from ..device import main as play
from .model import Base, Lidar, Model, ModelError, Register, WHEELS

#: Period of the clock, of the commands to the wheels and of the odometry, rig time.
PERIOD_S = 0.05
#: Age of a velocity command after which the robot stops, rig time.
COMMAND_AGE_S = 0.5
#: Time within which the slave of the wheels answers.
ANSWER_S = 0.1
#: Readings of a turn of an XV-11, bytes of a packet, packets of a turn.
READINGS, PACKET, PACKETS = 360, 22, 90
#: Measuring range of an XV-11, metres.
RANGE_M = (0.06, 6.0)
#: Bits of a packet's speed per turn a minute.
SPEED_PER_RPM = 64
#: First byte of a request to a slave of registers, and of its answer.
BUS = 0xAB


@dataclass(frozen=True)
class Scan:
    """A turn of the lidar."""

    #: Rig time at which the first packet of the turn arrived, after its four readings.
    at_s: float
    #: Duration of the turn.
    turn_s: float
    angle_min: float
    angle_increment: float
    #: Distances in metres; infinite without an echo.
    ranges: List[float]
    strengths: List[float]


@dataclass(frozen=True)
class Odometry:
    """The robot's own estimate, from its start on: x ahead, y to the left."""

    at_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_m_s: float
    turn_rad_s: float


class Sink:
    """A receiver of the robot's data. Its methods run between two requests of the rig."""

    def begin(self, model: Model) -> None:
        """Called before the first data."""

    def clock(self, now_s: float) -> None:
        """Called every ``PERIOD_S`` of rig time."""

    def scan(self, scan: Scan) -> None:
        """Called for each turn of the lidar."""

    def odometry(self, odometry: Odometry) -> None:
        """Called for each answer of the wheels."""

    def command(self) -> Optional[Tuple[int, float, float]]:
        """The latest velocity command: its number, metres and radians per second."""
        return None

    def end(self) -> None:
        """Called at the end of the run."""


class Robot(Device):
    """The robot's program."""

    def __init__(self, hello: Dict[str, Any], model: Model, sink: Sink) -> None:
        super().__init__(hello)
        self.model = model
        self.sink = sink
        names = [port["name"] for port in self.ports]
        self._lidar = _port(names, model.lidar)
        self._wheels = _port(names, model.base)

    def start(self) -> None:
        self._turn = Turn(self.model.lidar) if self.model.lidar is not None else None
        self._driver = Driver(self.model.base) if self.model.base is not None else None
        self._path = Path(self.model)
        #: Number of the last velocity command that the sink gave.
        self._number = 0
        #: Rig time, speed and turn rate of the last one that counts.
        self._command = (-math.inf, 0.0, 0.0)
        self.sink.begin(self.model)
        self.after(0.0, self.tick)

    def receive(self, data: bytes, now: float, port: int = 0) -> None:
        if port == self._lidar and self._turn is not None:
            for scan in self._turn.feed(data, now):
                self.sink.scan(scan)
        elif port == self._wheels and self._driver is not None:
            for address, values in self._driver.feed(data):
                if self._path.moves(address, values, now):
                    self.sink.odometry(self._path.odometry(now))
            self._send_next(now)

    def tick(self) -> None:
        """Publishes the clock, and commands the wheels."""
        now = self.now
        self.sink.clock(now)
        self.after(PERIOD_S, self.tick)
        if self._driver is None or self._wheels is None:
            return
        speed, turn = self._wanted(now)
        half = turn * self.model.axle_m / 2
        wheels = {"left": speed - half, "right": speed + half}
        self._path.commanded(self._driver.reached(wheels))
        if not self.model.base or not self.model.base.encoders:
            self._path.guess(now)
            self.sink.odometry(self._path.odometry(now))
        self._driver.drive(wheels)
        self._send_next(now)

    def _wanted(self, now: float) -> Tuple[float, float]:
        command = self.sink.command()
        if command is not None and command[0] != self._number:
            self._number, speed, turn = command
            if math.isfinite(speed) and math.isfinite(turn):
                self._command = (now, speed, turn)
            else:
                # Messages can contain NaN and infinity.
                said = f"velocity {speed} m/s, {turn} rad/s: ignored, expected finite values"
                print(said, file=sys.stderr, flush=True)
        at_s, speed, turn = self._command
        return (speed, turn) if now - at_s <= COMMAND_AGE_S else (0.0, 0.0)

    def _send_next(self, now: float) -> None:
        assert self._driver is not None and self._wheels is not None
        frame = self._driver.next_frame(now)
        if frame is not None:
            self.send(frame, port=self._wheels)


def _port(names: List[str], device: "Lidar | Base | None") -> Optional[int]:
    if device is None:
        return None
    if device.name not in names:
        known = ", ".join(names)
        sys.exit(f"the rig has no port {device.name}, expected one of {known}")
    return names.index(device.name)


class Turn:
    """Decodes the packets of an XV-11, turn by turn."""

    def __init__(self, lidar: Lidar) -> None:
        self._buffer = b""
        # The sensor's own angle 90 is ahead if the sensor is not rotated.
        self.angle_min = lidar.index0_rad - math.pi / 2
        self.angle_increment = math.radians(-1 if lidar.is_clockwise else 1)
        #: Index and arrival of the first and of the last packet of this turn.
        self._first: Optional[Tuple[int, float]] = None
        self._last = (0, 0.0)
        #: Duration of a turn at the speed that the last packet tells; zero means unknown.
        self._told_s = 0.0
        #: The first turn is published only if its beginning was seen.
        self._is_whole = False
        self._begin()

    def _begin(self) -> None:
        self._ranges = [math.inf] * READINGS
        self._strengths = [0.0] * READINGS

    def feed(self, data: bytes, now: float) -> List[Scan]:
        """Takes bytes; returns the turns that they complete."""
        scans: List[Scan] = []
        self._buffer += data
        while True:
            start = self._buffer.find(b"\xfa")
            self._buffer = self._buffer[start:] if start >= 0 else b""
            if len(self._buffer) < PACKET:
                return scans
            packet = self._buffer[:PACKET]
            if not is_sound(packet):
                self._buffer = self._buffer[1:]
                continue
            self._buffer = self._buffer[PACKET:]
            scans += self._take(packet, now)

    def _take(self, packet: bytes, now: float) -> List[Scan]:
        index = packet[1] - 0xA0
        scans = []
        if self._is_next(index, now):
            scans = self._scan(index, now)
            self._is_whole = self._first is not None or index == 0
            self._first = (index, now)
            self._begin()
        self._last = (index, now)
        speed = struct.unpack_from("<H", packet, 2)[0]
        self._told_s = 60 * SPEED_PER_RPM / speed if speed else 0.0
        for number in range(4):
            low, high, strength = struct.unpack_from("<BBH", packet, 4 + 4 * number)
            if not high & 0x80:
                self._ranges[4 * index + number] = (low | (high & 0x3F) << 8) / 1000
                self._strengths[4 * index + number] = float(strength)
        return scans

    def _is_next(self, index: int, now: float) -> bool:
        """Whether a packet begins a turn. Any packet may be lost, also the first of a turn."""
        last, at_s = self._last
        if self._first is None or index < last or self._is_gap(now):
            return True
        # The same packet may come twice.
        return index == last and now - at_s >= self._told_s / 2

    def _is_gap(self, now: float) -> bool:
        """Whether a whole turn was lost before a packet."""
        return 0 < self._told_s <= now - self._last[1]

    def _scan(self, index: int, now: float) -> List[Scan]:
        """The turn before the packet ``index``."""
        if self._first is None or not self._is_whole:
            return []
        first, at_s = self._first
        if self._is_gap(now):
            turn_s = self._told_s
        else:
            turn_s = (now - at_s) * PACKETS / (PACKETS - first + index)
        if turn_s <= 0:
            return []
        # The time at which the packet 0 arrives, also if it was lost.
        at_s -= turn_s * first / PACKETS
        optics = (self.angle_min, self.angle_increment)
        return [Scan(at_s, turn_s, *optics, self._ranges, self._strengths)]


def is_sound(packet: bytes) -> bool:
    """Whether a packet of an XV-11 has its index and its checksum."""
    total = 0
    for word in struct.unpack("<10H", packet[:20]):
        total = (total << 1) + word
    total = (total & 0x7FFF) + (total >> 15)
    is_index = 0xA0 <= packet[1] < 0xA0 + PACKETS
    return is_index and total & 0x7FFF == int(struct.unpack("<H", packet[20:])[0])


class Driver:
    """Speaks with the slave of the wheels, one request at a time."""

    def __init__(self, base: Base) -> None:
        self._base = base
        self._waiting: List[bytes] = []
        self._buffer = b""
        self._asked_s: Optional[float] = None

    def drive(self, wheels: Dict[str, float]) -> None:
        """Requests of the next period: the speeds of the wheels, then their encoders."""
        writes = [
            (register.address, register.counts(wheels[wheel]))
            for wheel, register in self._base.set_points.items()
        ]
        reads = [(one.address, one.size) for one in self._base.encoders.values()]
        is_high_first = self._base.is_high_first
        # Requests that were not sent in time are too old.
        self._waiting = [frame(*write, is_high_first) for write in joined(writes)]
        self._waiting += [request(*read, is_high_first) for read in joined_reads(reads)]

    def reached(self, wheels: Dict[str, float]) -> Dict[str, float]:
        """The speeds of wheels that obey the requests."""
        return {wheel: one.reached(wheels[wheel]) for wheel, one in self._base.set_points.items()}

    def next_frame(self, now: float) -> Optional[bytes]:
        """The next request, if the slave is idle or does not answer."""
        is_late = self._asked_s is not None and now - self._asked_s > ANSWER_S
        if not self._waiting or (self._asked_s is not None and not is_late):
            return None
        if is_late:
            self._buffer = b""
        self._asked_s = now
        return self._waiting.pop(0)

    def feed(self, data: bytes) -> List[Tuple[int, bytes]]:
        """Takes bytes; returns the answers: the first register and its values."""
        self._buffer += data
        answers: List[Tuple[int, bytes]] = []
        while True:
            start = self._buffer.find(bytes([BUS]))
            self._buffer = self._buffer[start:] if start >= 0 else b""
            if len(self._buffer) < 3:
                return answers
            length = self._buffer[2] & 0x7F
            if len(self._buffer) < length + 5:
                return answers
            body, total = self._buffer[: length + 3], self._buffer[length + 3 : length + 5]
            if checksum(body, self._base.is_high_first) != total:
                self._buffer = self._buffer[1:]
                continue
            self._buffer = self._buffer[length + 5 :]
            self._asked_s = None
            answers.append((body[1], body[3:]))


def checksum(body: bytes, is_high_first: bool) -> bytes:
    """The two last bytes of a frame: the sum of all before."""
    return (sum(body) & 0xFFFF).to_bytes(2, "big" if is_high_first else "little")


def frame(address: int, data: bytes, is_high_first: bool = False) -> bytes:
    """A request that writes ``data`` from register ``address`` on."""
    body = bytes([BUS, address, 0x80 | len(data)]) + data
    return body + checksum(body, is_high_first)


def request(address: int, size: int, is_high_first: bool = False) -> bytes:
    """A request that reads ``size`` bytes from register ``address`` on."""
    body = bytes([BUS, address, size])
    return body + checksum(body, is_high_first)


def joined(writes: List[Tuple[int, bytes]]) -> List[Tuple[int, bytes]]:
    """Writes of neighbouring registers as one."""
    found: List[Tuple[int, bytes]] = []
    for address, data in sorted(writes):
        if found and found[-1][0] + len(found[-1][1]) == address:
            found[-1] = (found[-1][0], found[-1][1] + data)
        else:
            found.append((address, data))
    return found


def joined_reads(reads: List[Tuple[int, int]]) -> List[Tuple[int, int]]:
    """Reads of neighbouring registers as one."""
    blocks = joined([(address, bytes(size)) for address, size in reads])
    return [(address, len(data)) for address, data in blocks]


class Path:
    """The robot's path by its wheels: by their encoders, or without these by their commands."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._encoders: Dict[str, Register] = model.base.encoders if model.base else {}
        self._pose = (0.0, 0.0, 0.0)
        self._speeds = (0.0, 0.0)
        self._counts: Dict[str, int] = {}
        self._wanted = {wheel: 0.0 for wheel in WHEELS}
        self._at_s: Optional[float] = None
        self._new: Dict[str, int] = {}

    def commanded(self, wheels: Dict[str, float]) -> None:
        self._wanted = dict(wheels)

    def moves(self, address: int, values: bytes, now: float) -> bool:
        """Takes an answer of the slave; returns whether both encoders are known."""
        for wheel, register in self._encoders.items():
            start = register.address - address
            if 0 <= start and start + register.size <= len(values):
                self._new[wheel] = register.value(values[start : start + register.size])
        if set(self._new) != set(WHEELS):
            return False
        new, self._new = self._new, {}
        travelled = {}
        for wheel in WHEELS:
            bits = 8 * self._encoders[wheel].size
            ticks = new[wheel] - self._counts.get(wheel, new[wheel])
            # A counter overflows.
            ticks = (ticks + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)
            travelled[wheel] = ticks * self._model.tick_m
        self._counts = new
        self._go(travelled, now)
        return True

    def guess(self, now: float) -> None:
        """Assumes that the wheels follow their commands."""
        since = 0.0 if self._at_s is None else now - self._at_s
        self._go({wheel: self._wanted[wheel] * since for wheel in WHEELS}, now)

    def _go(self, travelled: Dict[str, float], now: float) -> None:
        ahead = (travelled["left"] + travelled["right"]) / 2
        turn = (travelled["right"] - travelled["left"]) / self._model.axle_m
        x, y, heading = self._pose
        middle = heading + turn / 2
        self._pose = (x + ahead * math.cos(middle), y + ahead * math.sin(middle), heading + turn)
        since = 0.0 if self._at_s is None else now - self._at_s
        self._speeds = (ahead / since, turn / since) if since > 0 else (0.0, 0.0)
        self._at_s = now

    def odometry(self, now: float) -> Odometry:
        return Odometry(now, *self._pose, *self._speeds)


def main(about: str, sink: Callable[[argparse.Namespace], Sink], **options: Dict[str, Any]) -> None:
    """Runs a bridge: parses the command line, connects, and plays the robot's program."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("scenario", help="the scenario that the rig runs")
    for name, settings in options.items():
        parser.add_argument("--" + name.replace("_", "-"), **settings)
    arguments = parser.parse_args()
    try:
        model = Model.read(arguments.scenario)
    except ModelError as error:
        sys.exit(str(error))
    for note in model.notes:
        print(note, file=sys.stderr, flush=True)
    # Libraries may print; the rig reads only answers.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    receiver = sink(arguments)
    code = exit_code(
        lambda: play(lambda hello: Robot(hello, model, receiver), sys.stdin.buffer, answers)
    )
    code = exit_code(receiver.end) or code
    sys.stderr.flush()
    # The threads of a library may take longer than the rig waits for the end of this program, and
    # may not end at all.
    os._exit(code)


def exit_code(part: Callable[[], None]) -> int:
    """Runs a part of a program; prints its error as Python does."""
    try:
        part()
    except SystemExit as error:
        if error.code is None or isinstance(error.code, int):
            return error.code or 0
        print(error.code, file=sys.stderr)
        return 1
    except BaseException:
        traceback.print_exc()
        return 1
    return 0
