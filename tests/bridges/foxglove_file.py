"""Reads the bridge's MCAP file with Foxglove's reader, and draws the room.

usage: foxglove_file.py FILE
"""

import sys

from mcap_protobuf.reader import read_protobuf_messages

from messages import take
from room import Room

room = Room()
for one in read_protobuf_messages(sys.argv[1]):
    room.clock(one.log_time_ns / 1e9)
    take(room, one.topic, one.proto_msg)
# The order of the file is that of its writer; scans have the time of their first reading.
room.clocks.sort()
room.judge()
