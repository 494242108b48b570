"""Speed of the simulated board beside life: seconds of the board per second of processor time and of
wall time, for a sketch that polls and one that sleeps.

usage: python3 bench.py hilrig-simavr FOLDER-OF-ELF-FILES BOARDS-FOLDER"""
import resource
import sys
import time

sys.argv[1:] = sys.argv[1:4]
from host import Node
from pathlib import Path
import tomllib

PROGRAM, ELFS, BOARDS = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
S = 1_000_000_000


def board(name):
    read = tomllib.loads((BOARDS / f"{name}.toml").read_text())
    return {key: read[key] for key in ("mcu", "clock_hz", "uarts")}


def used():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def measure(what, slice_us, sleeps, seconds=20):
    before, began = used(), time.monotonic()
    wires = {"serial": {"unit": "uart", "number": 0}}
    settings = {"elf": str(ELFS / "probe-uno.elf"), "board": board("arduino-uno"), "wires": wires}
    node = Node([PROGRAM], ["serial"], settings | {"slice_us": slice_us})
    node.run(S // 10)
    if sleeps:
        node.send(0, b"s")
    node.run(node.now + seconds * S)
    exchanges = node.exchanges
    node.end()
    processor, wall = used() - before, time.monotonic() - began
    print(
        f"{what}, slice {slice_us} us: 1 s of the board in {processor / seconds:.3f} s of processor"
        f" time ({seconds / processor:.1f} x life) and {wall / seconds:.3f} s of wall time"
        f" ({seconds / wall:.1f} x life), {exchanges / seconds:.0f} exchanges a second"
    )


for slice_us in (100, 1000):
    measure("ATmega328P at 16 MHz that polls", slice_us, False)
measure("the same asleep", 100, True)
