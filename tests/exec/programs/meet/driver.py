"""Drives ahead until an obstacle is near, then stands. One program for both robots."""
import os
import sys
import termios
import time
import tty

KEEP_MM = 300 if len(sys.argv) < 2 else int(sys.argv[1])

port = os.open(os.environ["HILRIG_PORT_BASE"], os.O_RDWR | os.O_NOCTTY)
tty.setraw(port)
mode = termios.tcgetattr(port)
mode[4] = mode[5] = termios.B115200
termios.tcsetattr(port, termios.TCSANOW, mode)
stream = b""


def ask(request):
    """The answer, or None after 50 ms: a line may lose bytes."""
    global stream
    stream = b""
    os.write(port, request + b"\n")
    end = time.monotonic() + 0.05
    while time.monotonic() < end:
        try:
            stream += os.read(port, 256)
        except BlockingIOError:
            time.sleep(0.001)
        if b"\n" in stream:
            return stream.split(b"\n")[0]
    return None


os.set_blocking(port, False)
while True:
    said = ask(b"D")
    ahead = int(said[3:]) if said and said[3:].isdigit() else 0
    speed = 20 if ahead > KEEP_MM else 0
    ask(b"V %d %d" % (speed, speed))
    time.sleep(0.02)
