import os, sys, threading, time
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
# Read, compute, write back: another thread may have written meanwhile.
total = 0
def book():
    global total
    for _ in range(20):
        before = total
        time.sleep(0)
        total = before + 1
        time.sleep(0.01)
threads = [threading.Thread(target=book) for _ in range(2)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
if total != 40:
    sys.exit(7)
while True:
    print(len(os.read(fd, 100)), flush=True)
