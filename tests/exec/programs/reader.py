# pyserial: a thread reads lines into a queue, the other one takes them with a time limit, and asks.
import os
import queue
import threading
import time

import serial

port = serial.Serial(os.environ["HILRIG_PORT_SONAR"], 9600, timeout=0.05)
lines = queue.Queue()


def reader():
    while True:
        line = port.readline()
        if line:
            lines.put((time.monotonic(), line))


threading.Thread(target=reader, daemon=True).start()
asked = time.monotonic()
while True:
    try:
        at, line = lines.get(timeout=0.03)
        print(round(at, 6), line, flush=True)
        if line.startswith(b"mm="):
            port.write(b"ping\r\n")
    except queue.Empty:
        pass
    if time.monotonic() - asked > 0.25:
        asked = time.monotonic()
        port.write(b"ping\r\n")
