"""Sends wheel speeds to a driver over a line that loses and changes bytes."""
import os, select, sys, termios, time, tty

ports = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
tty.setraw(ports)
settings = termios.tcgetattr(ports)
settings[4] = settings[5] = termios.B115200
termios.tcsetattr(ports, termios.TCSANOW, settings)


def with_sum(text):
    return f"{text}*{sum(text.encode()) & 0xFF:02X}\n".encode()


def line(until):
    """The next line, without its end; None at `until`."""
    global rest
    while b"\n" not in rest:
        left = until - time.monotonic()
        if left <= 0 or not select.select([ports], [], [], left)[0]:
            return None
        rest += os.read(ports, 256)
    one, rest = rest.split(b"\n", 1)
    return one + b"\n"


rest = b""
tries = 0
# 20 cm/s for 6 s are the 1.2 m to the waypoint.
begin = time.monotonic()
for number in range(110):
    speed = 20 if time.monotonic() - begin < 6.0 else 0
    order, answer = with_sum(f"G {number} {speed}"), with_sum(f"A {number}")
    while True:
        tries += 1
        os.write(ports, order)
        until = time.monotonic() + 0.03
        said = line(until)
        while said not in (None, answer):
            said = line(until)
        if said == answer:
            break
    print(f"order {number}: {speed} cm/s after {tries} tries", flush=True)
    time.sleep(max(0.0, begin + 0.1 * (number + 1) - time.monotonic()))
while True:
    time.sleep(1)
