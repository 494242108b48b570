"""A reader of ROS 2 topics by Cyclone DDS: draws the room and drives to its waypoint. The types of
what it reads come from the bridge by discovery; so it checks their names and their fields."""

import time

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.dynamic import get_types_for_typeid
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from dataclasses import dataclass
import os

from room import Room, heading_of

#: Topics and types as a ROS 2 node names them.
NAMES = {
    "rt/clock": "rosgraph_msgs::msg::dds_::Clock_",
    "rt/scan": "sensor_msgs::msg::dds_::LaserScan_",
    "rt/odom": "nav_msgs::msg::dds_::Odometry_",
    "rt/tf": "tf2_msgs::msg::dds_::TFMessage_",
    "rt/tf_static": "tf2_msgs::msg::dds_::TFMessage_",
}


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


def seconds(stamp):
    return stamp.sec + stamp.nanosec / 1e9


participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
found = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
reliable = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepAll)
latched = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.History.KeepLast(10),
    Policy.Durability.TransientLocal,
)
commands = DataWriter(participant, Topic(participant, "rt/cmd_vel", Twist), qos=reliable)
readers, room = {}, Room()


def discover():
    for one in found.take(N=50):
        if one.topic_name in NAMES and one.topic_name not in readers and one.type_id is not None:
            assert one.type_name == NAMES[one.topic_name], one.type_name
            kind, _ = get_types_for_typeid(participant, one.type_id, duration(seconds=5))
            qos = latched if one.topic_name == "rt/tf_static" else reliable
            topic = Topic(participant, one.topic_name, kind, qos=qos)
            readers[one.topic_name] = DataReader(participant, topic, qos=qos)


def messages(topic):
    for one in readers[topic].take(N=1000) if topic in readers else []:
        # A writer that has left shows as a sample without data.
        if hasattr(one, "__dataclass_fields__"):
            yield one


def read():
    for one in messages("rt/clock"):
        room.clock(seconds(one.clock))
    for topic in ("rt/tf_static", "rt/tf"):
        for message in messages(topic):
            for one in message.transforms:
                moved, turned = one.transform.translation, one.transform.rotation
                place = (moved.x, moved.y, heading_of(turned.z, turned.w))
                room.transform(
                    one.header.frame_id, one.child_frame_id, seconds(one.header.stamp), place
                )
    for one in messages("rt/scan"):
        at = seconds(one.header.stamp)
        increment, turn_s = one.angle_increment, one.scan_time
        room.scan(one.header.frame_id, at, one.angle_min, increment, turn_s, one.ranges)
    for one in messages("rt/odom"):
        pose, twist = one.pose.pose.position, one.twist.twist
        room.odom(seconds(one.header.stamp), pose.x, pose.y, twist.linear.x, twist.angular.z)


until = time.monotonic() + 60
while time.monotonic() < until and not (room.is_there() and len(room.scans) > 30):
    discover()
    read()
    commands.write(Twist(Vector3(room.speed(), 0.0, 0.0), Vector3(0.0, 0.0, 0.0)))
    time.sleep(0.05)
assert set(readers) == set(NAMES), set(NAMES) - set(readers)
room.judge()
