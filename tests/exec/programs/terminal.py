# Asks its terminals for what a serial port does; a line for each: "key = value".
import array, errno, fcntl, os, select, struct, termios, time

DIR = os.environ["HILRIG_DIR"]
I, O, C, L, IN, OUT, CC = range(7)
LONG = 50
RAW8 = termios.CS8 | termios.CREAD | termios.CLOCAL


def tell(key, value):
    print(f"{key} = {value}", flush=True)


def settings(fd, iflag=0, oflag=0, cflag=RAW8, lflag=0, least=0, tenths=1, baud=None, **codes):
    now = termios.tcgetattr(fd)
    now[I], now[O], now[C], now[L] = iflag, oflag, cflag, lflag
    if baud is None:
        baud = now[OUT]
    now[IN] = now[OUT] = baud
    now[CC][termios.VMIN], now[CC][termios.VTIME] = least, tenths
    for name, code in codes.items():
        now[CC][getattr(termios, name)] = code
    termios.tcsetattr(fd, termios.TCSANOW, now)


def port(name, **how):
    fd = os.open(f"{DIR}/{name}", os.O_RDWR | os.O_NOCTTY)
    settings(fd, **how)
    return fd


def number(fd, request):
    found = array.array("i", [0])
    fcntl.ioctl(fd, request, found)
    return found[0]


def said(fd, want):
    """What comes: as many bytes as are wanted, however late, and what follows at once."""
    text, until = b"", time.monotonic() + LONG
    while len(text) < want and time.monotonic() < until:
        text += os.read(fd, 4096)
    return text + os.read(fd, 4096)


def through(fd, text, want, **how):
    """What the loop sends back."""
    settings(fd, **how)
    termios.tcflush(fd, termios.TCIOFLUSH)
    os.write(fd, text)
    return said(fd, want).hex()


def grown(fd, want):
    """How many bytes wait, once there are as many as are wanted."""
    until = time.monotonic() + LONG
    while number(fd, termios.FIONREAD) < want and time.monotonic() < until:
        time.sleep(0.02)
    return number(fd, termios.FIONREAD)


def coding(fd):
    c = termios.tcgetattr(fd)[C]
    data = {termios.CS5: 5, termios.CS6: 6, termios.CS7: 7, termios.CS8: 8}[c & termios.CSIZE]
    parity = "N" if not c & termios.PARENB else "O" if c & termios.PARODD else "E"
    return f"{data}{parity}{2 if c & termios.CSTOPB else 1}"


def failure(call, *arguments):
    try:
        return call(*arguments)
    except OSError as error:
        return errno.errorcode[error.errno]


# Rig time runs from the first opening on; the plug is out from 1 to 1.5 s.
plug = os.open(f"{DIR}/plug", os.O_RDWR | os.O_NOCTTY)
local = termios.tcgetattr(plug)[L]
tell("fresh port", "raw" if not local & (termios.ICANON | termios.ECHO) else "canonical, echo")
settings(plug)
waits = select.poll()
waits.register(plug, select.POLLIN)
while True:
    (_, events), = waits.poll()
    if events & select.POLLHUP:
        break
    os.read(plug, 4096)
tell("unplugged: poll", "POLLHUP" if events & select.POLLHUP else events)
tell("unplugged: read", failure(os.read, plug, 99))
tell("unplugged: write", failure(os.write, plug, b"x"))
tell("unplugged: ioctl", failure(number, plug, termios.TIOCMGET))
tell("unplugged: path", "gone" if not os.path.exists(f"{DIR}/plug") else "there")
os.close(plug)
while not os.path.exists(f"{DIR}/plug-1"):
    time.sleep(0.01)
# 11 bytes contain a whole line, wherever in a line the port was opened.
plug = port("plug-1", least=11)
tell("plugged in again", "another name, reads" if b"here" in os.read(plug, 99) else "silent")
os.close(plug)

# Settings.
ask = port("ask")
settings(ask, cflag=RAW8 | termios.PARENB)
tell("8E1 reads back", coding(ask))
settings(ask, cflag=termios.CS7 | termios.CREAD | termios.PARENB | termios.PARODD | termios.CSTOPB)
tell("7O2 reads back", coding(ask))
speeds = struct.unpack("44s", fcntl.ioctl(ask, 0x802C542A, b"\0" * 44))[0]
other = bytearray(speeds)
other[8:12] = struct.pack("I", struct.unpack("I", other[8:12])[0] & ~0o10017 | 0o10000)
other[36:44] = struct.pack("II", 250000, 250000)
fcntl.ioctl(ask, 0x402C542B, bytes(other))
speed = struct.unpack("I", fcntl.ioctl(ask, 0x802C542A, b"\0" * 44)[40:44])[0]
tell("250000 baud reads back", speed)
settings(ask, baud=termios.B115200)
serial = bytearray(72)
done = failure(fcntl.ioctl, ask, 0x541E, serial)
tell("low latency (TIOCSSERIAL)", done if isinstance(done, str) else "kept")

# Queues.
termios.tcflush(ask, termios.TCIOFLUSH)
os.write(ask, b"ping\r\n")
tell("bytes waiting (FIONREAD)", grown(ask, 6))
os.close(ask)
ask = port("ask")
tell("reopened port", "nothing old" if number(ask, termios.FIONREAD) == 0 else "old bytes")
slow = port("slow")
# A second of the line.
os.write(slow, b"0123456789" * 24)
sent = number(slow, termios.TIOCOUTQ)
tell("bytes to send (TIOCOUTQ)", "counted" if 0 < sent <= 240 else sent)
start = time.monotonic()
termios.tcdrain(slow)
tell("tcdrain", "waits for the line" if time.monotonic() - start > 0.1 else "returns at once")
os.write(slow, b"0123456789" * 6)
termios.tcflush(slow, termios.TCOFLUSH)
tell("TCOFLUSH", "discards" if number(slow, termios.TIOCOUTQ) < 5 else "discards nothing")
os.close(slow)
flood = port("flood", least=1, tenths=0)
tell("unread at most", grown(flood, 4095))
time.sleep(0.1)
termios.tcflush(flood, termios.TCIFLUSH)
tell("TCIFLUSH of a full port", "goes on" if len(os.read(flood, 99)) > 0 else "silent")
os.close(flood)

# Waiting.
settings(ask, tenths=1)
start = time.monotonic()
none = len(os.read(ask, 9))
waited = time.monotonic() - start
tell("VMIN 0, VTIME 1, nothing", f"{none} after {'0.1 s' if waited > 0.05 else waited}")
settings(ask, least=5, tenths=0)
os.write(ask, b"ping\r\n")
tell("VMIN 5 of 6 bytes", "at least 5" if len(os.read(ask, 5)) >= 5 else "fewer")
grown(ask, 1)
termios.tcflush(ask, termios.TCIFLUSH)
settings(ask, least=200, tenths=10)
os.write(ask, b"ping\r\n")
tell("VMIN 200, VTIME 1", len(os.read(ask, 64)))
settings(ask, least=1, tenths=0)
os.set_blocking(ask, False)
tell("O_NONBLOCK, nothing", failure(os.read, ask, 9))
settings(ask, least=0, tenths=0)
tell("the same with VMIN 0", failure(os.read, ask, 9))
os.set_blocking(ask, True)

# Characters.
loop = port("loop")
SEVEN = termios.CS7 | termios.CREAD | termios.CLOCAL
tell("ISTRIP of C1", through(loop, b"\xC1", 1, iflag=termios.ISTRIP))
tell("7 bits of C1", through(loop, b"\xC1", 1, cflag=SEVEN))
tell("ONLCR", through(loop, b"a\n", 3, oflag=termios.OPOST | termios.ONLCR))
tell("INLCR", through(loop, b"a\n", 2, iflag=termios.INLCR))
tell("PARMRK of a sound FF", through(loop, b"\xFF", 2, iflag=termios.PARMRK))
usual = dict(VEOF=4, VEOL=ord(";"), VERASE=127, VSTART=17, VSTOP=19)
settings(loop, iflag=termios.ICRNL, lflag=termios.ICANON, **usual)
termios.tcflush(loop, termios.TCIOFLUSH)
os.write(loop, b"one\rtwp\x7Fo\n")
tell("ICANON, ICRNL, VERASE", (os.read(loop, 99) + b"|" + os.read(loop, 99)).hex())
os.write(loop, b"x;")
tell("VEOL", os.read(loop, 99).hex())
os.write(loop, b"ab\x04")
tell("VEOF", os.read(loop, 99).hex())
settings(loop, iflag=termios.IXON, **usual)
termios.tcflush(loop, termios.TCIOFLUSH)
os.write(loop, b"a\x13")
said(loop, 1)
os.set_blocking(loop, False)
tell("IXON: write after XOFF", failure(os.write, loop, b"b"))
termios.tcflow(loop, termios.TCOON)
tell("the same after tcflow(TCOON)", failure(os.write, loop, b"b"))
settings(loop)
tell("the same with IXON off again", failure(os.write, loop, b"b"))
os.close(loop)


def damaged(iflag, want):
    settings(parity, iflag=iflag)
    termios.tcflush(parity, termios.TCIFLUSH)
    os.write(parity, b"p\n")
    return said(parity, want)[:want].hex() or "nothing"


def broken(iflag, want):
    settings(breaks, iflag=iflag)
    termios.tcflush(breaks, termios.TCIFLUSH)
    return said(breaks, want)[:want or 1].hex() or "nothing"


parity, breaks = port("parity"), port("breaks")
MARKED = termios.INPCK | termios.PARMRK
tell("parity error", damaged(0, 2))
tell("parity error, INPCK", damaged(termios.INPCK, 2))
tell("parity error, INPCK, IGNPAR", damaged(termios.INPCK | termios.IGNPAR, 0))
tell("parity error, INPCK, PARMRK", damaged(MARKED, 6))
tell("break", broken(0, 1))
tell("break, PARMRK", broken(termios.PARMRK, 3))
tell("break, IGNBRK", broken(termios.IGNBRK, 0))
rate = port("rate", baud=termios.B115200)
tell("wrong rate", "garbage" if said(rate, 1) else "silence")
# A program that ends at a wrong rate does not pass.
settings(rate, baud=termios.B9600)
for fd in parity, breaks, rate:
    os.close(fd)

# Two programs.
fcntl.ioctl(ask, termios.TIOCEXCL)
node = os.readlink(f"{DIR}/ask")
os.fchmod(ask, 0o666)
child = os.fork()
if child == 0:
    if os.geteuid() == 0:
        os.setuid(65534)
    os._exit(1 if failure(os.open, node, os.O_RDWR | os.O_NOCTTY) == "EBUSY" else 0)
tell("TIOCEXCL, a second open", "EBUSY" if os.waitpid(child, 0)[1] else "opens")
fcntl.ioctl(ask, termios.TIOCNXCL)
