"""A node of ROS 1 that publishes the lines of a port."""
import sys

import rospy
import serial
from std_msgs.msg import String

rospy.init_node("sonar", disable_signals=True)
lines = rospy.Publisher("/sonar", String, queue_size=10)
port = serial.Serial(sys.argv[1], 9600, timeout=1)
while not rospy.is_shutdown():
    lines.publish(port.readline().decode("ascii", "replace").strip())
