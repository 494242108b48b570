import struct

import serial

from common import port, run

line = serial.Serial(port(), 115200, timeout=0.2)


class Damaged(Exception):
    """A frame whose checksum does not hold, or none."""


def crc(data, value=0xFFFF):
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ (0x1021 if value & 0x8000 else 0)) & 0xFFFF
    return struct.pack("<H", value)


def stuffed(data):
    parts = (data + crc(data)).split(b"\0")
    return b"".join(bytes([len(part) + 1]) + part for part in parts) + b"\0"


def plain(frame):
    parts, at = [], 0
    while at < len(frame):
        parts.append(frame[at + 1:at + frame[at]])
        at += frame[at] or len(frame)
    return b"\0".join(parts)


def ask(request):
    line.reset_input_buffer()
    line.write(stuffed(request))
    found = plain(line.read_until(b"\0")[:-1])
    if len(found) != 17 or crc(found[:-2]) != found[-2:]:
        raise Damaged
    return struct.unpack("<BHfff", found[:-2])[2:]


run(line, {
    "temperature": lambda _: ask(struct.pack("<BH", 1, 7))[0],
    "heater": lambda _: ask(struct.pack("<BHf", 2, 8, 40))[2],
}, Damaged)
