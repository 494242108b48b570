"""The board layer by itself: its smallest firmware in QEMU, request by request.

usage: python3 test_echo.py echo.elf FOLDER-OF-HOST.PY"""
import subprocess
import sys

ELF, FOLDER = sys.argv[1:3]
sys.path.insert(0, FOLDER)
from host import BYTES, Node

MS = 1_000_000


def command(*words):
    told = "".join(f",arg={word}" for word in words)
    return [
        "qemu-system-arm", "-M", "mps2-an386", "-kernel", ELF, "-display", "none", "-monitor", "none",
        "-serial", "none", "-nic", "none", "-icount", "shift=2,sleep=off",
        "-semihosting-config", f"enable=on,target=native,arg=firmware{told}",
    ]


def ended(words, stdin):
    done = subprocess.run(command(*words), input=stdin, capture_output=True, timeout=60)
    return done.returncode, done.stderr.decode()


def bytes_leave_at_the_pace_of_the_line():
    """9600 baud, 8N1: a byte takes 1041666 ns. A dot comes every 100 ms."""
    node = Node(command("port=uart:1"), ["uart"], {})
    node.exchange(0)
    # The line's coding: 16, 9600 in little endian, 8 bits, no parity, 1 stop bit.
    assert [item[3] for item in node.items] == [bytes([16, 0x80, 0x25, 0, 0, 8, 0, 1])], node.items
    assert node.next == 100 * MS, node.next
    node.items.clear()
    node.exchange(10 * MS, [(BYTES, 0, b"abc")])
    assert node.next == 10 * MS + 1_041_666, node.next
    while node.next < 100 * MS:
        node.exchange(node.next)
    node.exchange(100 * MS)
    heard = b"".join(item[3] for item in node.items)
    assert heard == b"abc.", node.items
    said = node.end()
    assert "load: a tick of 1 ms has" in said, said


def wrong_words_end_the_firmware():
    for words, sentence in [
        (["port=usb:1"], "port=usb:1: this firmware has no such port"),
        (["port=uart"], "port=uart: expected NAME:PIECE"),
        (["cost=1:2"], "cost=1:2: expected more numbers"),
        (["colour=red"], "colour=red: this firmware has no settings"),
        (["colour"], "colour: expected KEY=VALUE"),
    ]:
        code, said = ended(words, b"")
        assert code == 2 and sentence in said, (code, said)
    # The rig's port is optional: the firmware goes on, until standard input ends.
    code, said = ended(["optional=usb:1"], b"")
    assert code == 1, (code, said)


def other_streams_end_the_firmware():
    code, said = ended(["port=uart:1"], b'{"hello": {}}\n')
    assert code == 101 and "leave out --json-nodes" in said, (code, said)
    huge = b"HRN1" + (1 << 24).to_bytes(4, "little") + b"X"
    code, said = ended(["port=uart:1"], huge)
    assert code == 101 and "16777220 bytes" in said, (code, said)


for test in [
    bytes_leave_at_the_pace_of_the_line,
    wrong_words_end_the_firmware,
    other_streams_end_the_firmware,
]:
    test()
    print("ok", test.__name__)
