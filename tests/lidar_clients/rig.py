"""A room with a lidar in it, offered by `hilrig up`, and one client at its port."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent

# The sensor stands off the middle and looks along x, so that a turned or mirrored turn shows.
SIZE_MM = (2600.0, 2200.0)
PLACE_MM = (1000.0, 1400.0)
# The wall to its left, and the corner ahead on its right: 1600 and 1400.
NEAREST_MM, FARTHEST_MM = 800.0, 2126.0
SCENARIO = """schema = 1
name = "lidar-room"
robot = "custom"
duration = "10min"

{device}

[world]
start = {{ x_m = 1.0, y_m = 1.4, heading_deg = 0 }}

[[world.wall]]
path_m = [[0, 0], [2.6, 0], [2.6, 2.2], [0, 2.2], [0, 0]]
"""
# A beam may be off by this angle: the encoder's steps, the jitter, the interpolation of a capsule.
ANGLE_DEG = 0.3
# 3.5 standard deviations of 0.25 % where there are no tails, and the roundings.
RANGE_PART, RANGE_MM = 0.01, 3.0
# The vendor's ROS node spreads the points of a turn evenly over its angles.
ANGLE_ROS_DEG = 1.5
# Clients that set DTR and cannot do without.
PYSERIAL = ("roboticia", "adafruit")
# Fewer points than this are no turn of a lidar that sends 2,000 a second.
POINTS_MIN = 150


def range_mm(degrees):
    """Distance of the wall at an angle, clockwise from ahead, by the geometry of the room."""
    angle = math.radians(degrees)
    ahead, left = math.cos(angle), -math.sin(angle)
    ways = []
    for along, place, size in ((ahead, PLACE_MM[0], SIZE_MM[0]), (left, PLACE_MM[1], SIZE_MM[1])):
        if abs(along) > 1e-9:
            ways.append(((size if along > 0 else 0.0) - place) / along)
    return min(ways)


def is_right(degrees, mm, slack_deg=ANGLE_DEG):
    """Whether a wall is where a point says."""
    around = [range_mm(degrees + off * slack_deg) for off in (-1, -0.5, 0, 0.5, 1)]
    low = min(around) * (1 - RANGE_PART) - RANGE_MM
    return low <= mm <= max(around) * (1 + RANGE_PART) + RANGE_MM


def is_distance(mm):
    """Whether a wall of the room is as far as that at any angle."""
    slack = RANGE_PART * mm + RANGE_MM
    return NEAREST_MM - slack <= mm <= FARTHEST_MM + slack


class Turn:
    """A turn as a client gave it; `at` seconds after the client was started."""

    def __init__(self, at, points, slack_deg=ANGLE_DEG):
        self.at = at
        # A point at distance 0 is no measurement, which some clients leave to the caller.
        self.points = [point for point in points if point[1] > 0]
        self.len = len(self.points)
        self.off = sum(not is_right(*point, slack_deg) for point in self.points)

    @property
    def right(self):
        return self.off == 0 and self.len >= POINTS_MIN


class Outcome:
    """What became of a client."""

    def __init__(self, turns, code, talk, ended_at):
        self.turns, self.code, self.talk, self.ended_at = turns, code, talk, ended_at

    @property
    def error(self):
        """The last line of what it said, where it ended by an error."""
        if self.code is not None and self.code < 0:
            return signal.Signals(-self.code).name
        lines = [line for line in self.talk.splitlines() if line.strip()]
        last = lines[-1] if lines else "says nothing"
        return re.sub(r"^(Error: |rplidar\.RPLidarException: |adafruit_rplidar\.\w+: )", "", last).strip('"')

    def end(self, length=3):
        """The last turns."""
        return self.turns[-length:]


def client_command(name, port, seconds, options):
    """How a client is started."""
    options = [f"{key}={value}" for key, value in options.items()]
    if name == "vendor":
        return [os.environ["VENDOR_SDK"], port, str(seconds), *options]
    if name == "ros":
        # Debian's modules are those of Debian's Python.
        return ["/usr/bin/python3", str(HERE / "ros_node.py"), port, str(seconds), *options]
    if name == "rs":
        return [os.environ["LIDAR_CLIENT_RS"], port, str(seconds), *options]
    return [sys.executable, str(HERE / "clients.py"), name, port, str(seconds), *options]


class Rig:
    """`hilrig up` with the lidar and the faults of these lines of a scenario; a context. The motor
    is run by DTR. Afterwards `starved` tells whether bytes were lost because a client did not read:
    a machine that gives it no time for 0.4 s does that, as to a UART."""

    def __init__(self, lines):
        table, motor = "[device.lidar.rplidar]", '\nmotor = "dtr"'
        self.starved = False
        self.lines = lines if motor in lines else lines.replace(table, table + motor, 1)

    def __enter__(self):
        self.folder = tempfile.TemporaryDirectory(prefix="lidar-")
        root = Path(self.folder.name)
        scenario = root / "room.toml"
        scenario.write_text(SCENARIO.format(device=self.lines))
        self.ports = root / "ports"
        hilrig = os.environ["HILRIG"]
        self.log = open(root / "up.log", "w+", encoding="utf-8")
        self.process = subprocess.Popen(
            [hilrig, "up", str(scenario), "--dir", str(self.ports)],
            stdout=self.log,
            stderr=subprocess.STDOUT,
        )
        until = time.monotonic() + 20
        while not self.said("running until"):
            if self.process.poll() is not None or time.monotonic() > until:
                raise SystemExit(f"hilrig up does not run:\n{self.text()}")
            time.sleep(0.02)
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.starved = self.said("because the client did not read")
        self.log.close()
        self.folder.cleanup()

    def text(self):
        return Path(self.log.name).read_text(encoding="utf-8")

    def said(self, words):
        return words in self.text()

    def run(self, name, seconds, patience=6.0, kill_after=None, **options):
        """Runs a client to its end; one that is not done `patience` seconds late is killed: it
        hangs. With `kill_after` it is killed then in any case."""
        environment = dict(os.environ)
        if name in PYSERIAL:
            environment["PYTHONPATH"] = str(HERE / "dtr")
            environment["HILRIG_DTR"] = str(self.ports / "lidar-dtr")
        command = client_command(name, str(self.ports / "lidar"), seconds, options)
        began = time.monotonic()
        client = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
        )
        lines, talk = [], []

        def listen():
            for line in client.stdout:
                lines.append((time.monotonic() - began, line))

        threads = [
            threading.Thread(target=listen),
            threading.Thread(target=lambda: talk.append(client.stderr.read())),
        ]
        for thread in threads:
            thread.start()
        code = None
        try:
            code = client.wait(kill_after or seconds + patience)
            ended_at = time.monotonic() - began
        except subprocess.TimeoutExpired:
            ended_at = time.monotonic() - began
            client.kill()
            client.wait()
        for thread in threads:
            thread.join()
        # A killed client may leave half a line.
        whole = [(at, line) for at, line in lines if line.endswith("\n")]
        slack_deg = ANGLE_ROS_DEG if name == "ros" else ANGLE_DEG
        turns = [Turn(at, json.loads(line)["turn"], slack_deg) for at, line in whole]
        return Outcome(turns, code, "".join(talk), ended_at)
