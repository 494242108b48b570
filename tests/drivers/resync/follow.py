"""Brakes by the distance that a range finder sends.

Defect: it reads frames of nine bytes one behind the other and never looks for their header. A lost
byte shifts all frames behind it.
"""
import os
import select
import sys

port = os.open(os.environ["HILRIG_PORT_SENSOR"], os.O_RDWR | os.O_NOCTTY)
broken = "broken" in sys.argv
held = b""
while True:
    select.select([port], [], [], 0.5)
    held += os.read(port, 100)
    while len(held) >= 9:
        if not broken and held[:2] != b"\x59\x59":
            held = held[1:]
            continue
        frame = held[:9]
        if sum(frame[:8]) & 255 != frame[8]:
            print("bad sum", frame.hex(" "), flush=True)
            held = held[9 if broken else 1:]
            continue
        held = held[9:]
        mm = frame[2] | frame[3] << 8
        brake = max(0, min(100, (900 - mm) // 5))
        print(mm, brake, flush=True)
        order = bytes([0x42, brake])
        os.write(port, order + bytes([sum(order) & 255]))
