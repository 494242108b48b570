"""Reads a meter by lines.

Defect: it opens the port at the rate of the meter's older model.
"""
import os
import select
import sys
import termios
import time
import tty

port = os.open(os.environ["HILRIG_PORT_METER"], os.O_RDWR | os.O_NOCTTY)
tty.setraw(port)
mode = termios.tcgetattr(port)
mode[4] = mode[5] = termios.B19200 if "broken" in sys.argv else termios.B38400
termios.tcsetattr(port, termios.TCSANOW, mode)
missed = 0
while True:
    os.write(port, b"P?\r\n")
    answer = b""
    while not answer.endswith(b"\r\n") and select.select([port], [], [], 0.2)[0]:
        answer += os.read(port, 100)
    missed = 0 if answer.endswith(b" W\r\n") else missed + 1
    print(answer, flush=True)
    if missed == 5:
        sys.exit("the meter does not answer")
    time.sleep(0.1)
