"""A ROS 1 node by Debian's rospy: draws the room and drives to its waypoint."""

import time

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from room import Room, heading_of

room = Room()


def transforms(message):
    for one in message.transforms:
        place = one.transform.translation, one.transform.rotation
        room.transform(
            one.header.frame_id,
            one.child_frame_id,
            one.header.stamp.to_sec(),
            (place[0].x, place[0].y, heading_of(place[1].z, place[1].w)),
        )


def scan(message):
    room.scan(
        message.header.frame_id,
        message.header.stamp.to_sec(),
        message.angle_min,
        message.angle_increment,
        message.scan_time,
        message.ranges,
    )


def odom(message):
    pose, twist = message.pose.pose.position, message.twist.twist
    room.odom(message.header.stamp.to_sec(), pose.x, pose.y, twist.linear.x, twist.angular.z)


rospy.init_node("mapper", disable_signals=True)
rospy.Subscriber("/clock", Clock, lambda message: room.clock(message.clock.to_sec()))
rospy.Subscriber("/tf", TFMessage, transforms)
rospy.Subscriber("/tf_static", TFMessage, transforms)
rospy.Subscriber("/scan", LaserScan, scan)
rospy.Subscriber("/odom", Odometry, odom)
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
until = time.monotonic() + 60
while time.monotonic() < until and not (room.is_there() and len(room.scans) > 30):
    twist = Twist()
    twist.linear.x = room.speed()
    commands.publish(twist)
    time.sleep(0.05)
room.judge()
