"""The sensor by hand: COBS and CRC-16, behind `socat pty,raw,echo=0,link=dev pty,raw,echo=0,link=drv`."""
import math
import random
import struct
import time

import serial

line = serial.Serial("dev", 115200, timeout=None)
begun = heard = time.monotonic()
heater = 0.0


def crc(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ (0x1021 if value & 0x8000 else 0)) & 0xFFFF
    return struct.pack("<H", value)


def stuffed(data):
    parts = data.split(b"\0")
    return b"".join(bytes([len(part) + 1]) + part for part in parts) + b"\0"


def plain(frame):
    parts, at = [], 0
    while at < len(frame):
        parts.append(frame[at + 1:at + frame[at]])
        at += frame[at] or len(frame)
    return b"\0".join(parts)


while True:
    body = plain(line.read_until(b"\0")[:-1])
    if len(body) < 5 or crc(body[:-2]) != body[-2:]:
        continue
    kind, tag = struct.unpack("<BH", body[:3])
    now = time.monotonic()
    if now - heard > 5:
        heater = 0.0
    heard = now
    if kind == 2 and len(body) == 9:
        heater = min(max(struct.unpack("<f", body[3:7])[0], 0), 100)
    elif kind != 1 or len(body) != 5:
        continue
    time.sleep(0.002)
    temperature = 21 + 2 * math.sin(math.tau * (now - begun) / 10)
    reply = struct.pack("<BHfff", 0x81, tag, temperature, random.gauss(1013, 0.2), heater)
    line.write(stuffed(reply + crc(reply)))
