"""The model car, its devices in one process and its program in another, driven over UDP: python-osc
sets level and steering, oscsend stops it, python-osc releases the stop in a bundle and sends an
unreadable goal. What the car does is asked at the control socket.

usage: drive.py    HILRIG names the program
"""

import json
import os
import socket
import subprocess
import sys
import tempfile
import time

from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder
from pythonosc.udp_client import SimpleUDPClient

SCENARIO = """schema = 1
name = "osc"
robot = "apollo13"
duration = "10min"

[world]
start = { x_m = 1.0, y_m = 3.0, heading_deg = 0 }

[[world.wall]]
path_m = [[0, 0], [8, 0], [8, 6], [0, 6], [0, 0]]
"""


class Rig:
    """Requests to the control socket."""

    def __init__(self, directory):
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(directory + "/control")
        self.file = self.socket.makefile("rw")

    def ask(self, do, **keys):
        self.file.write(json.dumps({"do": do, **keys}) + "\n")
        self.file.flush()
        answer = json.loads(self.file.readline())
        if not answer["ok"]:
            raise ValueError(f"{answer['key']}: {answer['message']}")
        return answer

    def wait(self, condition, timeout):
        return self.ask("wait", **{"for": condition}, timeout=timeout)["held"]

    def axes(self):
        axes = self.ask("state")["axes"]
        return {axis["name"]: axis["set_point"] for axis in axes}


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def until(condition, seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False


def message(address, *values):
    builder = OscMessageBuilder(address)
    for value in values:
        builder.add_arg(value)
    return builder.build()


def drive(rig, port):
    """What does not hold, in words."""
    phone = SimpleUDPClient("127.0.0.1", port)
    wrong = []

    def expect(what, holds):
        print(f"{'ok  ' if holds else 'FAIL'} {what}")
        if not holds:
            wrong.append(what)

    def is_at(level, steering):
        axes = rig.axes()
        return (axes["motor level"], axes["steering"]) == (level, steering)

    # A phone that is silent for a second stops the car, so the faders tell again and again.
    def fader():
        phone.send_message("/1/direction", 8.0)
        phone.send_message("/1/speed", 2.0)

    def drives():
        fader()
        return is_at(2, 8)

    expect("python-osc: level 2 and value 8 are on the board", until(drives, 20))
    begin = rig.ask("state")
    while rig.ask("state")["time_ns"] < begin["time_ns"] + 3_000_000_000:
        fader()
        time.sleep(0.1)
    end = rig.ask("state")
    moved = end["pose"]["x_m"] - begin["pose"]["x_m"]
    speed = moved * 1e9 / (end["time_ns"] - begin["time_ns"])
    expect(f"python-osc: it goes with 0.22 m/s ({speed:.2f})", 0.15 < speed < 0.25)

    subprocess.run(["oscsend", "localhost", str(port), "/1/kill", "f", "1"], check=True)
    stops = until(lambda: rig.axes()["motor level"] == 0, 5)
    expect("oscsend: the kill switch stops the motor", stops)
    phone.send_message("/1/speed", 2.0)
    time.sleep(0.5)
    expect("python-osc: the fader does nothing then", rig.axes()["motor level"] == 0)

    bundle = OscBundleBuilder(IMMEDIATELY)
    bundle.add_content(message("/1/kill", 0.0))
    bundle.add_content(message("/1/direction", -30.0))
    bundle.add_content(message("/1/speed", 1.0))
    phone.send(bundle.build())
    expect("python-osc: a bundle of three releases it", until(lambda: is_at(1, -30), 5))

    phone.send_message("/goal", ["here", True, b"blob"])
    subprocess.run(["oscsend", "localhost", str(port), "/1/speed", "i", "0"], check=True)
    expect("oscsend: a whole number stops it", until(lambda: rig.axes()["motor level"] == 0, 5))
    return wrong


def main():
    hilrig, port = os.environ["HILRIG"], free_port()
    with tempfile.TemporaryDirectory() as folder:
        scenario, ports = folder + "/osc.toml", folder + "/ports"
        with open(scenario, "w", encoding="utf-8") as file:
            file.write(SCENARIO)
        place = ["--pc", "--dut-at", f"phone=udp:{port}"]
        up = subprocess.Popen(
            [hilrig, "up", scenario, "--dir", ports, *place], stdout=subprocess.DEVNULL
        )
        dut = None
        try:
            if not until(lambda: os.path.exists(ports + "/control"), 20):
                sys.exit("hilrig up: no control socket after 20 s")
            dut = subprocess.Popen(
                [hilrig, "dut", "--dir", ports, "--scenario", scenario], stdout=subprocess.DEVNULL
            )
            time.sleep(0.5)
            wrong = drive(Rig(ports), port)
        finally:
            for process in (dut, up):
                if process is not None:
                    process.terminate()
                    process.wait()
    if wrong:
        sys.exit(f"{len(wrong)} of what was expected did not happen")


main()
