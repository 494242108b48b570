"""Reads a range finder that is asked by lines.

Defect: after an error it waits until another program connects again, and none does.
"""
import os
import select
import sys
import time

port = os.open(os.environ["HILRIG_PORT_HEAD"], os.O_RDWR | os.O_NOCTTY)
broken = "broken" in sys.argv


def ask():
    os.write(port, b"GD\n")
    answer = b""
    while not answer.endswith(b"\n"):
        if not select.select([port], [], [], 0.3)[0]:
            return None
        answer += os.read(port, 100)
    return answer.decode().strip()


is_well = True
while True:
    if is_well:
        answer = ask()
        is_well = answer is not None
        print("range", answer, flush=True)
    elif broken:
        time.sleep(0.5)
    else:
        print("again", flush=True)
        is_well = True
    time.sleep(0.05)
