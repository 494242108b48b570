"""The clients of the Python world, used as their own examples use them. Each turn that a client
gives is printed as a line of JSON: {"turn": [[degrees, millimetres], ..]}; what it is told
besides goes to stderr.

usage: clients.py sdk|roboticia|adafruit PORT SECONDS [sessions=N] [mode=MODE] [buffer=N]

sessions  scans that share the time, with a stop in between
mode      of rplidar-roboticia: normal, force, express
buffer    measurements after which rplidar-roboticia and adafruit throw away what waits; 0: never,
          so that a busy machine is not charged to the lidar
"""

import json
import math
import sys
import time


def tell(points):
    print(json.dumps({"turn": [[round(a, 3), round(d, 2)] for a, d in points]}), flush=True)


def note(*words):
    print(*words, file=sys.stderr, flush=True)


def whole_turns(measurements, until):
    """Cuts measurements where the client says that a turn begins."""
    turn = None
    for new_turn, _, angle, distance in measurements:
        if new_turn:
            if turn:
                tell(turn)
            turn = []
        if turn is not None and distance > 0:
            turn.append((angle, distance))
        if time.monotonic() >= until:
            return


def sdk(port, seconds, options):
    """pyrplidarsdk: the vendor's own SDK. Chooses the mode by itself: what the sensor calls
    typical, the legacy scan if it knows no configuration requests."""
    from pyrplidarsdk import RplidarDriver

    driver = RplidarDriver(port=port, baudrate=115200)
    if not driver.connect():
        raise SystemExit("connect() is False")
    info, health = driver.get_device_info(), driver.get_health()
    note("info:", info, "health:", health and (health.status, health.error_code))
    sessions = int(options.get("sessions", 1))
    for _ in range(sessions):
        if not driver.start_scan():
            raise SystemExit("start_scan() is False")
        until = time.monotonic() + seconds / sessions
        while time.monotonic() < until:
            scan = driver.get_scan_data()
            if scan is None:
                note("passed over: get_scan_data() is None")
                time.sleep(0.05)
                continue
            angles, metres = scan[:2]
            tell([(math.degrees(a), m * 1e3) for a, m in zip(angles, metres)])
        driver.stop_scan()
    driver.disconnect()


def roboticia(port, seconds, options):
    """rplidar-roboticia."""
    from rplidar import RPLidar

    lidar = RPLidar(port)
    note("info:", lidar.get_info(), "health:", lidar.get_health())
    sessions = int(options.get("sessions", 1))
    for _ in range(sessions):
        measurements = lidar.iter_measures(
            options.get("mode", "normal"), 5 * int(options.get("buffer", 0))
        )
        whole_turns(measurements, time.monotonic() + seconds / sessions)
        lidar.stop()
        lidar.stop_motor()
    lidar.disconnect()


def adafruit(port, seconds, options):
    """adafruit-circuitpython-rplidar."""
    from adafruit_rplidar import RPLidar

    lidar = RPLidar(None, port, timeout=3)
    note("info:", lidar.info, "health:", lidar.health)
    sessions = int(options.get("sessions", 1))
    for _ in range(sessions):
        measurements = lidar.iter_measurements(int(options.get("buffer", 0)))
        whole_turns(measurements, time.monotonic() + seconds / sessions)
        lidar.stop()
        lidar.stop_motor()
    lidar.disconnect()


CLIENTS = {"sdk": sdk, "roboticia": roboticia, "adafruit": adafruit}

if __name__ == "__main__":
    if len(sys.argv) < 4 or sys.argv[1] not in CLIENTS:
        raise SystemExit(__doc__)
    settings = dict(option.split("=", 1) for option in sys.argv[4:])
    CLIENTS[sys.argv[1]](sys.argv[2], float(sys.argv[3]), settings)
