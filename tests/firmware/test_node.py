"""The node program hilrig-simavr by itself: a probe sketch on each board, then bad input.

usage: python3 test_node.py hilrig-simavr FOLDER-OF-ELF-FILES BOARDS-FOLDER"""
import json
import random
import socket
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path

from host import BYTES, LINE, NEVER, OUTPUT, VIOLATION, Node, struct, text, values

PROGRAM, ELFS, BOARDS = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
US, MS = 1_000, 1_000_000
FAULT = 3


def board(name):
    """The board as hilrig gives it to the program."""
    read = tomllib.loads((BOARDS / f"{name}.toml").read_text())
    pins = {}
    for pin, at in read["pins"].items():
        pins[pin] = {"at": at["at"]} | ({"channel": at["adc"]} if "adc" in at else {})
    return {
        "mcu": read["mcu"],
        "clock_hz": read["clock_hz"],
        "vcc_volts": read["vcc_volts"],
        "uarts": read["uarts"],
        "pins": pins,
    }


def start(name="arduino-uno", elf="probe-uno.elf", uart=0, outputs=("d9", "d4"), **more):
    settings = {
        "elf": str(ELFS / elf),
        "board": board(name),
        "wires": {
            "serial": {"unit": "uart", "number": uart},
            "i2c": {"unit": "twi"},
            "flash": {"unit": "spi"},
        },
        "outputs": list(outputs),
    }
    return Node([PROGRAM], ["serial", "i2c", "flash"], settings | more, ["a1", "d7"])


def ask(node, letter, milliseconds=5):
    """The lines that a command of the sketch is answered."""
    fresh = node.send(0, letter)
    fresh += node.run(node.now + milliseconds * MS)
    return fresh


def booted(**more):
    node = start(**more)
    assert text(node.run(50 * MS)) == "cause 1\r\nboots 0\r\n", node.said()
    return node


def test_bytes_have_the_times_of_the_line():
    """16 MHz and a divisor of 17 with double speed: 117,647 baud, 85 us a character of ten bits."""
    node = booted()
    coding = [data for _, kind, _, data in node.items if kind == LINE]
    assert coding == [bytes([16]) + struct.pack("<IBBB", 117_647, 8, 0, 1)], coding
    fresh = ask(node, b"b")
    times = [when for when, kind, _, _ in fresh if kind == BYTES]
    assert text(fresh) == "0123456789"
    assert {b - a for a, b in zip(times, times[1:])} == {85 * US}, times


def test_a_deaf_program_loses_bytes_as_the_receiver_does():
    """1 ms without interrupts: two characters, and the last one in the shift register."""
    fresh = ask(booted(), b"oABCDEF", 20)
    assert text(fresh).split("\r\n") == ["waiting 3", "got 65", "got 66", "got 70", ""]


def test_pins_are_measured_and_given():
    node = booted()
    volts = [(VIOLATION, 0, struct.pack("<d", 2500.0)), (VIOLATION, 1, struct.pack("<d", 1.0))]
    node.exchange(node.now, volts)
    # 2.5 V of 5 V are 512 of 1024.
    assert text(ask(node, b"a")) == "volts 512\r\n"
    assert text(ask(node, b"d")) == "level 1\r\n"
    # analogWrite(9, 64): timer 1, phase-correct, 64 of 255.
    assert [round(value, 4) for _, value in values(ask(node, b"p"), 0)] == [0.0, 0.251]
    fresh = ask(node, b"t")
    assert [value for _, value in values(fresh, 2)] == [0.0, 1.0, 0.0]
    # A pulse of 1500 us, and what digitalWrite takes.
    (_, width), = values(fresh, 3)
    assert 1500 <= width < 1530, width


def test_the_bus_waits_for_the_chip():
    node = booted()
    fresh, asked, end = node.send(0, b"i"), [], node.now + 30 * MS
    while node.next <= end:
        came = node.exchange(node.next)
        fresh += came
        for when, kind, port, data in came:
            if kind != BYTES or port != 1:
                continue
            asked.append(data.hex())
            if data[0] != 2:
                continue
            is_there = data[2] >> 1 == 0x68
            read = bytes([0x68, 7, 9]) if data[2] & 1 else b""
            answer = bytes([2, 0, len(read)]) + read if is_there else bytes([2, 1, 0])
            # Later than a slice: the program waits as for a chip that holds the clock.
            fresh += node.run(when + 700 * US)
            fresh += node.exchange(node.now, [(BYTES, 1, answer)])
    assert asked == ["0202d000", "0302d075", "0202d140", "040103", "02026600"], asked
    expected = ["write 0", "read 3", "byte 104", "byte 7", "byte 9", "absent 2", ""]
    assert text(fresh).split("\r\n") == expected
    # Silence is no acknowledge, and ends by itself.
    assert text(ask(booted(), b"i", 50)).split("\r\n")[0] == "write 2"


def test_a_byte_of_spi_is_exchanged_for_one():
    node = booted()
    fresh, sent, end = node.send(0, b"m"), [], node.now + 20 * MS
    while node.next <= end:
        came = node.exchange(node.next)
        fresh += came
        for when, kind, port, data in came:
            if kind == BYTES and port == 2:
                sent.append(data)
                # The second one is not answered: the line is up.
                if len(sent) == 1:
                    node.run(when + 5 * US)
                    fresh += node.exchange(node.now, [(BYTES, 2, b"\xA5")])
    assert sent == [b"\x42", b"\x43"] and text(fresh) == "first 165\r\nsecond 255\r\n", text(fresh)


def test_a_program_that_hangs_is_reset_by_its_watchdog():
    """WDTO_250MS; the flag is WDRF; the EEPROM is kept."""
    node = booted()
    began = node.now
    fresh = ask(node, b"w", 1_000)
    assert text(fresh) == "cause 8\r\nboots 1\r\n", text(fresh)
    first = next(when for when, kind, _, _ in fresh if kind == BYTES)
    # 32 K cycles at 128 kHz are 256 ms, then the core's start.
    assert 256 * MS < first - began < 262 * MS, (first - began) / MS


def test_faults_reset_and_cut_power():
    node = booted()
    fault = lambda name, begins: struct.pack("<Bd", begins, float("nan")) + name
    node.exchange(node.now, [(FAULT, 0, fault(b"reset", 1))])
    assert text(node.run(node.now + 50 * MS)) == "cause 2\r\nboots 1\r\n"
    node.exchange(node.now, [(FAULT, 0, fault(b"off", 1))])
    assert node.next == NEVER and ask(node, b"b") == []
    node.exchange(node.now, [(FAULT, 0, fault(b"off", 0))])
    assert text(node.run(node.now + 50 * MS)) == "cause 1\r\nboots 2\r\n"


def test_sleep_costs_nothing():
    node = booted()
    ask(node, b"s")
    before = node.exchanges
    node.run(node.now + 60_000 * MS)
    assert node.exchanges - before <= 1 and node.next == NEVER
    assert text(ask(node, b"q", 10)) == "woke 113\r\n"


def test_a_crash_is_told_and_is_the_end():
    node = booted()
    fresh = ask(node, b"x", 50)
    (_, kind, _, data), = [item for item in fresh if item[1] == VIOLATION]
    assert data.startswith(b"crash\0the firmware crashed at address"), data
    assert node.next == NEVER


def test_two_runs_are_the_same_bytes():
    runs = []
    for _ in range(2):
        node = booted()
        for letters in (b"a", b"tb", b"w", b"oABCDEF", b"i"):
            ask(node, letters, 400)
        node.end()
        runs.append(node.items)
    assert runs[0] == runs[1] and len(runs[0]) > 100


def test_what_is_left_out_changes_nothing():
    """The same bytes at the same nanoseconds with every turn of the sketch's loop."""
    runs = []
    for leave_out_idle in (True, False):
        node = booted(leave_out_idle=leave_out_idle)
        for letters in (b"a", b"d", b"p", b"t", b"b", b"w", b"oABCDEF", b"i", b"a"):
            ask(node, letters, 700)
        node.end()
        runs.append(node.items)
    assert runs[0] == runs[1] and len(runs[0]) > 100, [len(run) for run in runs]


def test_each_board_runs_the_probe():
    for name, elf, uart in [
        ("arduino-mega", "probe-mega.elf", 0),
        ("leonardo", "probe1-leonardo.elf", 1),
        ("mighty-1284p", "probe-mighty.elf", 0),
    ]:
        node = start(name, elf, uart)
        # The Leonardo's core starts its USB first.
        assert text(node.run(200 * MS)) == "cause 1\r\nboots 0\r\n", (name, node.said())
        node.exchange(node.now, [(VIOLATION, 0, struct.pack("<d", 1000.0))])
        assert text(ask(node, b"a")) == "volts 204\r\n", name
        assert text(ask(node, b"w", 1_000)) == "cause 8\r\nboots 1\r\n", name


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def test_a_rig_that_is_gone_ends_a_program_that_gdb_holds():
    node = start(gdb=free_port())
    # It waits for gdb in the midst of an exchange.
    node.process.stdin.write(struct.pack("<IcQH", 11, b"X", 20 * MS, 0))
    node.process.stdin.flush()
    time.sleep(0.2)
    assert node.process.poll() is None
    node.process.stdin.close()
    node.process.stdout.close()
    assert node.process.wait(timeout=10) == 0, node.said()


def test_a_rig_that_is_gone_ends_a_long_exchange():
    """A day in one exchange takes minutes; the program notices the end of its rig before."""
    node = start()
    node.process.stdin.write(struct.pack("<IcQH", 11, b"X", 86_400_000 * MS, 0))
    node.process.stdin.flush()
    node.process.stdin.close()
    assert node.process.wait(timeout=20) == 0, node.said()


def test_names_are_texts_of_the_greeting():
    name = 'a"b\\c\n'
    pins = {**board("arduino-uno")["pins"], name: {"at": "B1"}}
    node = start(board={**board("arduino-uno"), "pins": pins}, outputs=[name])
    assert node.outputs == [name, name + "_us"]
    for long, said in [({"mcu": "x" * 64}, "too long"), ({"pins": {"y" * 64: {"at": "B1"}}}, "too long")]:
        try:
            start(board={**board("arduino-uno"), **long}, outputs=[])
        except EOFError as error:
            assert said in str(error), error
        else:
            raise AssertionError(long)


def test_gdb_holds_the_program_and_changes_no_byte():
    """A breakpoint-less session by hand: stopped at first, held by an interrupt, then let go."""
    plain = booted().items
    port = free_port()
    node = start(gdb=port)
    talk = []

    def debugger():
        gdb = socket.create_connection(("127.0.0.1", port), timeout=20)
        for packet in (b"$?#3f", b"$p22#d4"):
            gdb.sendall(packet)
            talk.append(gdb.recv(200))
            time.sleep(0.2)
        gdb.sendall(b"$c#63")
        time.sleep(0.2)
        gdb.close()

    person = threading.Thread(target=debugger)
    person.start()
    fresh = node.run(50 * MS)
    person.join()
    assert text(fresh) == "cause 1\r\nboots 0\r\n", talk
    # A reply may be read in parts.
    assert node.items == plain and b"T05" in b"".join(talk), talk


def refusal(**more):
    try:
        start(**more)
    except EOFError as error:
        return str(error)
    raise AssertionError("was accepted")


def test_what_cannot_be_run_names_the_fix():
    assert "No such file" in refusal(elf="absent.elf")
    assert "was built for atmega328p, the board has atmega2560" in refusal(name="arduino-mega")
    (ELFS / "text.elf").write_text("hello")
    assert "not an ELF file; give the .elf that the linker wrote" in refusal(elf="text.elf")
    (ELFS / "host.elf").write_bytes(Path("/bin/true").read_bytes())
    assert "a program for another processor" in refusal(elf="host.elf")
    (ELFS / "object.elf").write_bytes((ELFS / "probe-uno.o").read_bytes())
    assert "an object file or library; give the linked program" in refusal(elf="object.elf")
    assert "d99" in refusal(outputs=["d99"])
    assert "slice_us is 1, expected 10 to 10000" in refusal(slice_us=1)


def run_raw(stream):
    """The program's status for any bytes; never a signal."""
    done = subprocess.run([PROGRAM], input=stream, capture_output=True, timeout=20)
    assert done.returncode in (0, 2), (done.returncode, stream[:200], done.stderr)
    return done.stderr.decode(errors="replace")


def test_no_bytes_make_it_crash():
    """Damaged ELF files, greetings and exchanges, from a fixed seed: an error, or a run."""
    dice = random.Random(1)
    elf = (ELFS / "probe-uno.elf").read_bytes()
    hello = {
        "hilrig_node": 1,
        "name": "x",
        "ports": [{"name": "serial", "rate": 1, "format": "8N1"}],
        "quantities": ["a1"],
        "settings": {
            "elf": str(ELFS / "damaged.elf"),
            "board": board("arduino-uno"),
            "wires": {"serial": {"unit": "uart", "number": 0}},
            "outputs": ["d9"],
        },
    }
    frame = lambda kind, body: struct.pack("<I", len(body) + 1) + kind + body
    items = struct.pack("<BBHQ", 1, 0, 3, 0) + b"abc" + struct.pack("<BBHQd", 4, 0, 8, 0, 1.0)
    asked = frame(b"X", struct.pack("<QH", 20 * MS, 2) + items) + frame(b"E", b"")
    greeting = frame(b"H", json.dumps(hello).encode())
    for case in range(150):
        damaged = bytearray(elf)
        # The head, the tables, or the code.
        reach = (52, 400, len(damaged))[case % 3]
        for _ in range(1 + dice.randrange(12)):
            damaged[dice.randrange(reach)] = dice.randrange(256)
        if case % 10 == 0:
            del damaged[dice.randrange(len(damaged)) :]
        (ELFS / "damaged.elf").write_bytes(damaged)
        run_raw(b"HRN1" + greeting + asked)
    (ELFS / "damaged.elf").write_bytes(elf)
    whole = greeting + asked
    for case in range(150):
        damaged = bytearray(whole)
        for _ in range(1 + dice.randrange(6)):
            damaged[dice.randrange(len(damaged))] = dice.randrange(256)
        if case % 5 == 0:
            del damaged[dice.randrange(len(damaged)) :]
        run_raw(b"HRN1" + bytes(damaged))
    assert "speaks the binary form only" in run_raw(b'{"hilrig_node": 1}')
    assert "begins with neither" in run_raw(b"hello")
    assert "no request of a rig" in run_raw(b"")


tests = [test for name, test in sorted(globals().items()) if name.startswith("test_")]
for test in tests:
    test()
    print(f"ok {test.__name__[5:]}", flush=True)
print(f"{len(tests)} tests of the node program passed")
