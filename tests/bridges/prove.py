"""Each bridge with a real reader: a robot in a room is driven to its waypoint by commands of the
reader, which draws the room. The rig judges the run: the waypoint counts if the robot is there.

usage: prove.py [foxglove] [ros1] [ros2]     HILRIG: the command
"""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
SCENARIO = ROOT / "scenarios" / "custom-robot.toml"
HILRIG = os.environ["HILRIG"]
#: Debian's Python, which has rospy.
DEBIAN = "/usr/bin/python3"


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def bridged(python, module, reader, env, folder, options=()):
    """Runs the rig with a bridge, and a reader beside it; both must succeed."""
    env = {**os.environ, **env, "PYTHONPATH": f"{ROOT / 'python' / 'src'}:{HERE}"}
    words = [python, "-m", f"hilrig.bridges.{module}", str(SCENARIO), *options]
    command = [HILRIG, "run", str(SCENARIO), "--realtime", "--out", str(folder / "out")]
    rig = subprocess.Popen(
        [*command, "--node", " ".join(words)],
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        subprocess.run(reader, env=env, check=True, timeout=120)
        said, _ = rig.communicate(timeout=60)
    finally:
        rig.kill()
    assert "ok   waypoints-visited" in said and "ok   node-programs" in said, said
    print("  the rig: waypoint visited", flush=True)


def foxglove(folder):
    port, mcap = free_port(), folder / "run.mcap"
    options = ["--port", str(port), "--mcap", str(mcap)]
    reader = [sys.executable, str(HERE / "foxglove_live.py"), str(port)]
    bridged(sys.executable, "foxglove", reader, {}, folder, options)
    env = {**os.environ, "PYTHONPATH": str(HERE)}
    reader = [sys.executable, str(HERE / "foxglove_file.py"), str(mcap)]
    subprocess.run(reader, env=env, check=True)


def ros1(folder):
    port = free_port()
    env = {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    env["ROS_LOG_DIR"] = str(folder)
    master = subprocess.Popen(
        ["rosmaster", "--core", "-p", str(port)],
        env={**os.environ, **env},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        until = time.monotonic() + 30
        while socket.socket().connect_ex(("127.0.0.1", port)) != 0:
            assert time.monotonic() < until, "no ROS master"
            time.sleep(0.1)
        bridged(DEBIAN, "ros1", [DEBIAN, str(HERE / "ros1.py")], env, folder)
    finally:
        master.kill()
        master.wait()


def ros2(folder):
    # Another domain than that of a ROS on this machine.
    env = {"ROS_DOMAIN_ID": str(100 + os.getpid() % 100)}
    env["CYCLONEDDS_URI"] = "<CycloneDDS><Domain><General><AllowMulticast>spdp</AllowMulticast></General></Domain></CycloneDDS>"
    bridged(sys.executable, "ros2", [sys.executable, str(HERE / "ros2.py")], env, folder)


for name in sys.argv[1:] or ["foxglove", "ros1", "ros2"]:
    print(name, flush=True)
    folder = Path(tempfile.mkdtemp(prefix="hilrig-bridge-"))
    try:
        {"foxglove": foxglove, "ros1": ros1, "ros2": ros2}[name](folder)
    finally:
        shutil.rmtree(folder)
