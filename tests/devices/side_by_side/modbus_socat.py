"""The meter of 12 registers by hand, behind `socat pty,raw,echo=0,link=dev pty,raw,echo=0,link=drv`."""
import math
import random
import struct
import time

import serial

line = serial.Serial("dev", 9600, timeout=0.004)
begun = time.monotonic()
relay = True
holding = struct.pack(">HHH8s", 1, 2500, 100, b"line 1")


def crc(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return struct.pack("<H", value)


def inputs():
    now = time.monotonic() - begun
    volts = random.gauss(230, 0.5)
    amps = 3.5 if relay else 0.0
    hertz = 50 + 0.05 * math.sin(math.tau * now / 20)
    return struct.pack(">fffHHII", volts, amps, volts * amps * 0.95, 950, round(hertz * 100),
                       int(now / 3), 20261127)


def answer(body):
    global relay, holding
    function = body[0]
    if function in (3, 4):
        table = holding if function == 3 else inputs()
        at, count = struct.unpack(">HH", body[1:5])
        data = table[2 * at:2 * (at + count)]
        if len(data) != 2 * count or not count:
            return bytes([function | 0x80, 2])
        return bytes([function, len(data)]) + data
    if function == 1:
        at, count = struct.unpack(">HH", body[1:5])
        return bytes([1, 1, relay]) if (at, count) == (0, 1) else bytes([0x81, 2])
    if function == 5:
        at, value = struct.unpack(">HH", body[1:5])
        if at:
            return bytes([0x85, 2])
        relay = value == 0xFF00
        return body
    if function in (6, 16):
        at = struct.unpack(">H", body[1:3])[0]
        data = body[3:5] if function == 6 else body[6:]
        if 2 * at + len(data) > len(holding):
            return bytes([function | 0x80, 2])
        holding = holding[:2 * at] + data + holding[2 * at + len(data):]
        return body[:5]
    return bytes([function | 0x80, 1])


frame = b""
while True:
    part = line.read(1)
    frame += part
    if part or not frame:
        continue
    request, frame = frame, b""
    if len(request) > 4 and request[0] == 1 and crc(request[:-2]) == request[-2:]:
        time.sleep(0.02)
        reply = b"\x01" + answer(request[1:-2])
        line.write(reply + crc(reply))
