"""Starts the vendor's ROS node, listens to its scans, and prints each as clients.py does.
The node has a master of its own.

usage: ros_node.py PORT SECONDS [mode=NAME]     ROS_NODE names the node's program
"""

import json
import math
import os
import socket
import subprocess
import sys
import time


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def main():
    port, seconds = sys.argv[1], float(sys.argv[2])
    options = dict(option.split("=", 1) for option in sys.argv[3:])
    os.environ["ROS_MASTER_URI"] = f"http://127.0.0.1:{free_port()}"
    os.environ["ROS_IP"] = "127.0.0.1"
    number = os.environ["ROS_MASTER_URI"].rsplit(":", 1)[1]
    master = subprocess.Popen(["rosmaster", "--core", "-p", number], stdout=sys.stderr)
    node = None
    try:
        import rospy
        from sensor_msgs.msg import LaserScan

        until = time.monotonic() + 20
        while time.monotonic() < until:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", int(number))) == 0:
                    break
            time.sleep(0.05)
        words = [f"_serial_port:={port}", "_serial_baudrate:=115200", "_angle_compensate:=false"]
        if "mode" in options:
            words.append(f"_scan_mode:={options['mode']}")
        node = subprocess.Popen([os.environ["ROS_NODE"], *words], stdout=sys.stderr)
        rospy.init_node("judge", disable_signals=True)

        def tell(scan):
            # The node turns the sensor's angles, clockwise, into those of ROS: pi less the angle.
            angles = (scan.angle_min + n * scan.angle_increment for n in range(len(scan.ranges)))
            points = [
                [round((180 - math.degrees(angle)) % 360, 3), round(1e3 * metres, 2)]
                for angle, metres in zip(angles, scan.ranges)
                if math.isfinite(metres)
            ]
            print(json.dumps({"turn": points}), flush=True)

        rospy.Subscriber("/scan", LaserScan, tell, queue_size=100)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            time.sleep(0.05)
            if node.poll() is not None:
                raise SystemExit(f"the node ended with {node.returncode}")
    finally:
        for process in (node, master):
            if process:
                process.terminate()
                process.wait()


if __name__ == "__main__":
    main()
