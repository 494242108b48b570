"""A bridge to ROS 1 by rospy: ``/scan``, ``/odom``, ``/tf``, ``/tf_static`` and ``/clock`` out,
``/cmd_vel`` in.

::

    roscore &
    rosparam set use_sim_time true
    hilrig run robot.toml --realtime --node 'python3 -m hilrig.bridges.ros1 robot.toml'
"""

from __future__ import annotations

import argparse
import math
import sys
from typing import Any, Optional, Tuple

from .model import Lidar, Model
from .robot import RANGE_M, READINGS, Odometry, Scan, Sink, main

#: Frames of REP 105.
ODOM, BASE, LASER = "odom", "base_link", "laser"


class Ros1(Sink):
    """A ROS node."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        try:
            import rosgraph
            import rospy
        except ImportError as error:
            sys.exit(
                f"{error}: install ROS 1, e.g. Debian's ros-core, python3-sensor-msgs and "
                "python3-nav-msgs"
            )
        if not rosgraph.is_master_online():
            sys.exit("no ROS master answers: start roscore, or set ROS_MASTER_URI")
        self._ros: Any = rospy
        self._command: Optional[Tuple[int, float, float]] = None
        rospy.init_node(arguments.name, disable_signals=True)

    def begin(self, model: Model) -> None:
        from geometry_msgs.msg import Twist
        from nav_msgs.msg import Odometry as OdometryMessage
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import LaserScan
        from tf2_msgs.msg import TFMessage

        publisher = self._ros.Publisher
        self._clock = publisher("/clock", Clock, queue_size=10)
        self._scan = publisher("/scan", LaserScan, queue_size=10)
        self._odom = publisher("/odom", OdometryMessage, queue_size=10)
        self._tf = publisher("/tf", TFMessage, queue_size=100)
        self._static = publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        self._ros.Subscriber("/cmd_vel", Twist, self._hear)
        if model.lidar is not None:
            self._static.publish(TFMessage([self._mount(model.lidar)]))

    def _hear(self, twist: Any) -> None:
        number = self._command[0] + 1 if self._command is not None else 1
        self._command = (number, twist.linear.x, twist.angular.z)

    def command(self) -> Optional[Tuple[int, float, float]]:
        return self._command

    def clock(self, now_s: float) -> None:
        from rosgraph_msgs.msg import Clock

        self._clock.publish(Clock(self._time(now_s)))

    def scan(self, scan: Scan) -> None:
        from sensor_msgs.msg import LaserScan

        message = LaserScan()
        message.header.stamp = self._time(scan.at_s)
        message.header.frame_id = LASER
        message.angle_min = scan.angle_min
        message.angle_max = scan.angle_min + (READINGS - 1) * scan.angle_increment
        message.angle_increment = scan.angle_increment
        message.time_increment = scan.turn_s / READINGS
        message.scan_time = scan.turn_s
        message.range_min, message.range_max = RANGE_M
        message.ranges = scan.ranges
        message.intensities = scan.strengths
        self._scan.publish(message)

    def odometry(self, odometry: Odometry) -> None:
        from nav_msgs.msg import Odometry as OdometryMessage
        from tf2_msgs.msg import TFMessage

        message = OdometryMessage()
        message.header.stamp = self._time(odometry.at_s)
        message.header.frame_id = ODOM
        message.child_frame_id = BASE
        message.pose.pose.position.x = odometry.x_m
        message.pose.pose.position.y = odometry.y_m
        message.pose.pose.orientation.z = math.sin(odometry.heading_rad / 2)
        message.pose.pose.orientation.w = math.cos(odometry.heading_rad / 2)
        message.twist.twist.linear.x = odometry.speed_m_s
        message.twist.twist.angular.z = odometry.turn_rad_s
        self._odom.publish(message)
        place = (odometry.x_m, odometry.y_m, odometry.heading_rad)
        transform = self._transform(ODOM, BASE, place, odometry.at_s)
        self._tf.publish(TFMessage([transform]))

    def end(self) -> None:
        self._ros.signal_shutdown("the run has ended")

    def _time(self, at_s: float) -> Any:
        # Time 0 means "latest" to tf, and "no time yet" to rospy.
        return self._ros.Time.from_sec(max(at_s, 1e-9))

    def _mount(self, lidar: Lidar) -> Any:
        return self._transform(BASE, LASER, (lidar.x_m, lidar.y_m, lidar.heading_rad), 0.0)

    def _transform(
        self, parent: str, child: str, place: Tuple[float, float, float], at_s: float
    ) -> Any:
        from geometry_msgs.msg import TransformStamped

        message = TransformStamped()
        message.header.stamp = self._time(at_s)
        message.header.frame_id = parent
        message.child_frame_id = child
        message.transform.translation.x = place[0]
        message.transform.translation.y = place[1]
        message.transform.rotation.z = math.sin(place[2] / 2)
        message.transform.rotation.w = math.cos(place[2] / 2)
        return message


if __name__ == "__main__":
    name = {"default": "hilrig", "help": "name of the ROS node (default: %(default)s)"}
    main(__doc__.split(":")[0], Ros1, name=name)
