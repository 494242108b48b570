"""Messages of the telemetry link, judged by Python's own library of protocol buffers. The schema is
made here, from the numbers of the fields alone: nothing is generated.

Both ways: Python writes a message, the example `telemetry` of the crate `protocols` says what it
reads there and writes it anew, and Python reads that. Besides, Python must write the very bytes
that the crate's own tests have by hand.

usage: telemetry.py    TELEMETRY names the example
"""

import os
import random
import struct
import subprocess
import sys

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

FIELD = descriptor_pb2.FieldDescriptorProto
FLOAT, UINT32, INT32 = FIELD.TYPE_FLOAT, FIELD.TYPE_UINT32, FIELD.TYPE_INT32
ONE, MANY = FIELD.LABEL_OPTIONAL, FIELD.LABEL_REPEATED

# Number, name, how often, type: a name of a message, or a type of the library.
SCHEMA = {
    "State": [(1, "name", ONE, "StateName")],
    "Pose": [(1, "x", ONE, FLOAT), (2, "y", ONE, FLOAT), (3, "alpha", ONE, FLOAT)],
    "Covariance": [(1, "value", MANY, FLOAT)],
    "Odometry": [(1, "pose", ONE, "Pose"), (2, "covariance", ONE, "Covariance")],
    "Point": [(1, "angle", ONE, INT32), (2, "distance", ONE, INT32), (3, "quality", ONE, INT32)],
    "Lidar": [(1, "timestamp", ONE, UINT32), (2, "point", MANY, "Point")],
    "Line": [(1, "start", ONE, "Pose"), (2, "end", ONE, "Pose")],
    "LidarLines": [(1, "line", MANY, "Line")],
    "Range": [(1, "distance", ONE, FLOAT)],
    "Infrared": [(1, "timestamp", ONE, UINT32), (2, "range", MANY, "Range")],
    "Telemetry": [
        (1, "timestamp", ONE, UINT32),
        (2, "state", ONE, "State"),
        (3, "odometry", ONE, "Odometry"),
        (4, "lidar", ONE, "Lidar"),
        (5, "lines", ONE, "LidarLines"),
        (6, "infrared", ONE, "Infrared"),
    ],
    "Velocities": [(1, "linear", ONE, FLOAT), (2, "angular", ONE, FLOAT)],
    "LinesRequest": [
        (1, "gap", ONE, UINT32),
        (2, "tolerance", ONE, UINT32),
        (3, "merge", ONE, UINT32),
    ],
    "Reactive": [
        (1, "distance_min", ONE, FLOAT),
        (2, "distance_max", ONE, FLOAT),
        (3, "speed", ONE, FLOAT),
        (4, "turn_gain", ONE, FLOAT),
    ],
    "Telecommand": [
        (1, "timestamp", ONE, UINT32),
        (2, "state", ONE, "State"),
        (3, "velocities", ONE, "Velocities"),
        (4, "corrected_pose", ONE, "Pose"),
        (5, "desired_pose", ONE, "Pose"),
        (6, "lidar_step", ONE, UINT32),
        (7, "lines", ONE, "LinesRequest"),
        (8, "reactive", ONE, "Reactive"),
    ],
}
STATES = {"OFF": 1, "MANUAL": 2, "AUTO_REACTIVE": 3, "AUTO_POSITION": 4}
# Most entries of what is repeated: the robot's space for them.
MOST = {"value": 9, "point": 40, "line": 20, "range": 6}
# All that the robot and the PC always write.
NEEDED = {"State", "Pose", "Point", "Line", "Range", "Velocities", "LinesRequest"}
MESSAGES = 2_000
SEED = 20


def classes():
    """The messages of the schema as classes."""
    file = descriptor_pb2.FileDescriptorProto(name="link.proto", package="link", syntax="proto2")
    states = file.enum_type.add(name="StateName")
    for name, number in STATES.items():
        states.value.add(name=name, number=number)
    for name, fields in SCHEMA.items():
        message = file.message_type.add(name=name)
        for number, field, label, kind in fields:
            if kind in SCHEMA:
                how = {"type": FIELD.TYPE_MESSAGE, "type_name": f".link.{kind}"}
            elif kind == "StateName":
                how = {"type": FIELD.TYPE_ENUM, "type_name": ".link.StateName"}
            else:
                how = {"type": kind}
            message.field.add(name=field, number=number, label=label, **how)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    get = message_factory.GetMessageClass
    return {name: get(pool.FindMessageTypeByName(f"link.{name}")) for name in SCHEMA}


def float32(value):
    return struct.unpack("<f", struct.pack("<f", value))[0]


def scalar(kind, dice):
    if kind == "StateName":
        return dice.choice(list(STATES.values()))
    if kind == UINT32:
        return dice.choice([0, 1, 127, 128, 300, 2**32 - 1, dice.randrange(2**32)])
    if kind == INT32:
        return dice.choice([0, -1, 359, 10_000, -(2**31), 2**31 - 1])
    return dice.choice([0.0, -0.0, 123456.0, float32(dice.uniform(-1e4, 1e4)), float32(1e-42)])


def fill(message, name, dice):
    """Gives a message values by chance; what may be missing sometimes is."""
    for _, field, label, kind in SCHEMA[name]:
        needed = name in NEEDED or field in ("timestamp", "pose") and name != "Infrared"
        if label == MANY:
            # An empty covariance is no field at all.
            least = 1 if field == "value" else 0
            for _ in range(dice.randint(least, MOST[field])):
                if kind in SCHEMA:
                    fill(getattr(message, field).add(), kind, dice)
                else:
                    getattr(message, field).append(scalar(kind, dice))
        elif not needed and dice.random() < 0.4:
            continue
        elif kind in SCHEMA:
            getattr(message, field).SetInParent()
            fill(getattr(message, field), kind, dice)
        else:
            setattr(message, field, scalar(kind, dice))


def told(message, name, path=""):
    """The fields of a message as the example lists them."""
    list_ = []
    for _, field, label, kind in SCHEMA[name]:
        here = f"{path}{field}"
        if label == ONE and not message.HasField(field):
            continue
        # The example leaves out the message that only holds the list.
        for value in getattr(message, field) if label == MANY else [getattr(message, field)]:
            if kind in SCHEMA:
                list_ += told(value, kind, f"{here}.")
            elif kind == FLOAT:
                list_.append(f"{here}={struct.pack('>f', value).hex()}")
            else:
                list_.append(f"{here}={value}")
    return list_


def by_hand(link):
    """The messages whose bytes stand in the tests of the crate, written there by hand."""
    telemetry = link["Telemetry"](timestamp=300)
    telemetry.state.name = STATES["AUTO_REACTIVE"]
    pose = telemetry.odometry.pose
    pose.x, pose.y, pose.alpha = 1.0, -2.0, 0.5
    telemetry.lidar.timestamp = 5
    telemetry.lidar.point.add(angle=-1, distance=200, quality=15)
    line = telemetry.lines.line.add()
    for end in (line.start, line.end):
        end.x = end.y = end.alpha = 0.0
    telemetry.infrared.range.add(distance=0.25)
    zero = "0d00000000" "1500000000" "1d00000000"
    yield telemetry, (
        "08ac02" "12020803" "1a110a0f" "0d0000803f" "15000000c0" "1d0000003f"
        "22140805" "121008ffffffffffffffffff01" "10c801" "180f"
        f"2a240a22" f"0a0f{zero}" f"120f{zero}" "320712050d0000803e"
    )
    command = link["Telecommand"](timestamp=0, lidar_step=10)
    command.state.name = STATES["AUTO_POSITION"]
    command.velocities.linear, command.velocities.angular = 0.5, -1.0
    pose = command.desired_pose
    pose.x, pose.y, pose.alpha = 0.0, 0.0, 123456.0
    lines = command.lines
    lines.gap, lines.tolerance, lines.merge = 300, 60, 170
    command.reactive.speed = 2.0
    yield command, (
        "0800" "12020804" "1a0a0d0000003f15000080bf" "2a0f0d0000000015000000001d0020f147"
        "300a" "3a0808ac02103c18aa01" "42051d00000040"
    )


def main():
    link = classes()
    for message, expected in by_hand(link):
        written = message.SerializeToString().hex()
        if written != expected:
            raise SystemExit(f"Python writes {written}, the crate's tests have {expected}")
    dice = random.Random(SEED)
    messages = [message for message, _ in by_hand(link)]
    for index in range(MESSAGES):
        name = ("Telemetry", "Telecommand")[index % 2]
        message = link[name]()
        fill(message, name, dice)
        messages.append(message)
    names = [message.DESCRIPTOR.name for message in messages]
    bytes_ = [message.SerializeToString() for message in messages]
    lines = [f"{name.lower()} {data.hex()}\n" for name, data in zip(names, bytes_)]
    example = subprocess.run(
        [os.environ["TELEMETRY"]], input="".join(lines), capture_output=True, text=True, check=True
    )
    answers = example.stdout.splitlines()
    assert len(answers) == len(messages), f"{len(answers)} answers to {len(messages)} messages"
    for name, message, data, answer in zip(names, messages, bytes_, answers):
        fields, bar, written = answer.partition("|")
        where = f"{name} {data.hex()}:\n{answer}"
        if not bar or fields.split() != told(message, name):
            raise SystemExit(f"the crate reads otherwise than Python writes: {where}")
        if link[name].FromString(bytes.fromhex(written)) != message:
            raise SystemExit(f"Python reads otherwise than the crate writes: {where}")
    print(f"ok   {len(messages)} messages of the telemetry link, both ways, 2 of them as by hand")
    return 0


if __name__ == "__main__":
    sys.exit(main())
