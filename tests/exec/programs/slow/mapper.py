# Keeps a map: each fifth line of the sonar updates it, in a thread of its own.
import os, threading
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
cells = [0] * 1000
def update(lines):
    for step in range(1000000):
        cells[step % 1000] += lines
lines = 0
while True:
    lines += os.read(fd, 64).count(b'\n')
    if lines >= 5:
        worker = threading.Thread(target=update, args=(lines,))
        worker.start()
        worker.join()
        os.write(fd, b'ping\r\n')
        lines = 0
