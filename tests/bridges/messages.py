"""Foxglove's messages for a room."""

from room import heading_of


def seconds(stamp):
    return stamp.seconds + stamp.nanos / 1e9


def take(room, topic, message):
    """Gives a message of `topic` to the room."""
    if topic == "/tf":
        for one in message.transforms:
            heading = heading_of(one.rotation.z, one.rotation.w)
            place = (one.translation.x, one.translation.y, heading)
            room.transform(one.parent_frame_id, one.child_frame_id, seconds(one.timestamp), place)
    elif topic == "/scan":
        count = len(message.ranges)
        increment = (message.end_angle - message.start_angle) / (count - 1)
        at = seconds(message.timestamp)
        # The message has no duration of a turn; an XV-11 turns five times a second.
        room.scan(message.frame_id, at, message.start_angle, increment, 0.2, message.ranges)
    elif topic == "/odom":
        place = message.pose.position
        at = seconds(message.timestamp)
        last = room.odometry[-1] if room.odometry else (at, place.x)
        speed = (place.x - last[1]) / (at - last[0]) if at > last[0] else 0.0
        room.odom(at, place.x, place.y, speed, 0.0)
    else:
        raise AssertionError(topic)
