"""Turns a fan by the humidity that a sensor tells; temperature and humidity are asked in turn.

Defect: after a time-out it goes on with the next question. The late reply is then taken for the
reply to that, and all later ones are one behind.
"""
import os
import select
import sys
import time

port = os.open(os.environ["HILRIG_PORT_CLIMATE"], os.O_RDWR | os.O_NOCTTY)
broken = "broken" in sys.argv
held = b""


def ask(question):
    global held
    if not broken:
        while select.select([port], [], [], 0)[0]:
            os.read(port, 100)
        held = b""
    os.write(port, question + b"\r\n")
    while b"\r\n" not in held:
        if not select.select([port], [], [], 0.15)[0]:
            print(question, "no reply", flush=True)
            if not broken:
                time.sleep(0.5)
            return None
        held += os.read(port, 100)
    line, held = held.split(b"\r\n", 1)
    return line.decode()


while True:
    kelvin = ask(b"T?")
    percent = ask(b"H?")
    print(kelvin, "K", percent, "%", flush=True)
    if percent is not None and percent.isdigit():
        ask(b"FAN %d" % int(percent))
    time.sleep(0.05)
