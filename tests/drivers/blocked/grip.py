"""Reads a gripper's number.

Defect: the read of an answer has no time-out, so a cut answer stops the program for ever.
"""
import os
import select
import sys
import time

port = os.open(os.environ["HILRIG_PORT_GRIP"], os.O_RDWR | os.O_NOCTTY)
broken = "broken" in sys.argv


def answer(length):
    got = b""
    while len(got) < length:
        if not broken and not select.select([port], [], [], 0.1)[0]:
            break
        got += os.read(port, length - len(got))
    return got


while True:
    os.write(port, bytes.fromhex("ab 00 04 af 00"))
    got = answer(9)
    print(int.from_bytes(got[3:7], "little") if len(got) == 9 else "cut", flush=True)
    time.sleep(0.1)
