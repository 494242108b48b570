"""A bridge to ROS 2 by Cyclone DDS: ``/scan``, ``/odom``, ``/tf``, ``/tf_static`` and ``/clock``
out, ``/cmd_vel`` in. It needs the package ``cyclonedds`` of PyPI, and no installation of ROS.

::

    pip install cyclonedds
    hilrig run robot.toml --realtime --node 'python3 -m hilrig.bridges.ros2 robot.toml'
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from typing import Any, Optional, Tuple

from .model import Model
from .robot import RANGE_M, READINGS, Odometry, Scan, Sink, main

#: Frames of REP 105.
ODOM, BASE, LASER = "odom", "base_link", "laser"


class Ros2(Sink):
    """Topics of ROS 2."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        try:
            from cyclonedds.domain import DomainParticipant
        except ImportError as error:
            sys.exit(f"{error}: pip install cyclonedds")
        from . import ros2_types

        self._types: Any = ros2_types
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        if not domain.isdigit():
            sys.exit(f"ROS_DOMAIN_ID is {domain!r}, expected a whole number from 0 to 232")
        self._participant: Any = DomainParticipant(int(domain))
        self._command: Optional[Tuple[int, float, float]] = None

    def begin(self, model: Model) -> None:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.util import duration

        reliable = Policy.Reliability.Reliable(duration(milliseconds=100))
        usual = Qos(reliable, Policy.History.KeepLast(10))
        latched = Qos(reliable, Policy.History.KeepLast(1), Policy.Durability.TransientLocal)
        types = self._types
        self._clock = self._writer("clock", types.Clock, usual)
        self._scan = self._writer("scan", types.LaserScan, usual)
        self._odom = self._writer("odom", types.Odometry, usual)
        self._tf = self._writer("tf", types.TFMessage, usual)
        self._static = self._writer("tf_static", types.TFMessage, latched)
        topic = self._topic("cmd_vel", types.Twist, usual)
        best_effort = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(1))
        self._commands: Any = DataReader(self._participant, topic, qos=best_effort)
        if model.lidar is not None:
            lidar = model.lidar
            place = (lidar.x_m, lidar.y_m, lidar.heading_rad)
            self._static.write(types.TFMessage([self._transform(BASE, LASER, place, 0.0)]))

    def _topic(self, name: str, kind: Any, qos: Any) -> Any:
        from cyclonedds.topic import Topic

        return Topic(self._participant, f"rt/{name}", kind, qos=qos)

    def _writer(self, name: str, kind: Any, qos: Any) -> Any:
        from cyclonedds.pub import DataWriter

        return DataWriter(self._participant, self._topic(name, kind, qos), qos=qos)

    def command(self) -> Optional[Tuple[int, float, float]]:
        for twist in self._commands.take(N=100):
            if isinstance(twist, self._types.Twist):
                number = self._command[0] + 1 if self._command is not None else 1
                self._command = (number, twist.linear.x, twist.angular.z)
        return self._command

    def clock(self, now_s: float) -> None:
        self._clock.write(self._types.Clock(self._time(now_s)))

    def scan(self, scan: Scan) -> None:
        message = self._types.LaserScan(
            header=self._header(scan.at_s, LASER),
            angle_min=scan.angle_min,
            angle_max=scan.angle_min + (READINGS - 1) * scan.angle_increment,
            angle_increment=scan.angle_increment,
            time_increment=scan.turn_s / READINGS,
            scan_time=scan.turn_s,
            range_min=RANGE_M[0],
            range_max=RANGE_M[1],
            ranges=scan.ranges,
            intensities=scan.strengths,
        )
        self._scan.write(message)

    def odometry(self, odometry: Odometry) -> None:
        types = self._types
        place = (odometry.x_m, odometry.y_m, odometry.heading_rad)
        pose = types.Pose(types.Point(*place[:2], 0.0), self._rotation(place[2]))
        twist = types.Twist(
            types.Vector3(odometry.speed_m_s), types.Vector3(z=odometry.turn_rad_s)
        )
        message = types.Odometry(
            header=self._header(odometry.at_s, ODOM),
            child_frame_id=BASE,
            pose=types.PoseWithCovariance(pose),
            twist=types.TwistWithCovariance(twist),
        )
        self._odom.write(message)
        self._tf.write(types.TFMessage([self._transform(ODOM, BASE, place, odometry.at_s)]))

    def _time(self, at_s: float) -> Any:
        nanoseconds = round(at_s * 1e9)
        return self._types.Time(nanoseconds // 10**9, nanoseconds % 10**9)

    def _header(self, at_s: float, frame: str) -> Any:
        return self._types.Header(self._time(at_s), frame)

    def _rotation(self, heading: float) -> Any:
        return self._types.Quaternion(z=math.sin(heading / 2), w=math.cos(heading / 2))

    def _transform(
        self, parent: str, child: str, place: Tuple[float, float, float], at_s: float
    ) -> Any:
        types = self._types
        moved = types.Transform(types.Vector3(place[0], place[1]), self._rotation(place[2]))
        return types.TransformStamped(self._header(at_s, parent), child, moved)


if __name__ == "__main__":
    main(__doc__.split(":")[0], Ros2)
