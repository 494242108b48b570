"""Speed of firmware in simulators beside life: seconds of the rig per second of wall time and of
processor time (the rig's and the simulator's), each with all of its devices.

usage: python3 bench.py HILRIG FOLDER-OF-CORTEX-M4-ELFS FOLDER-FOR-RESULTS [AVR-SCENARIO AVR-ELF WIRE..]"""
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

HILRIG, ELFS, OUT = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])


def used():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def measure(what, scenario, *options):
    before, began = used(), time.monotonic()
    out = OUT / "bench"
    subprocess.run(
        [HILRIG, "run", str(scenario), "--out", str(out), *map(str, options)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True,
    )
    processor, wall = used() - before, time.monotonic() - began
    result = json.loads((out / "result.json").read_text())
    seconds = result["metrics"]["sim_s"]
    print(
        f"{what}: {seconds:.0f} s of life in {wall:.1f} s of wall time ({seconds / wall:.1f} x life) "
        f"and {processor:.1f} s of processor time ({seconds / processor:.1f} x life)",
        flush=True,
    )


M4 = ["--board", "cortex-m4", "--firmware"]
for _ in range(2):
    measure("yellow on a Cortex-M4, ticks of 1 ms", "scenarios/yellow-reactive.toml", *M4, ELFS / "yellow")
    measure("rescue on a Cortex-M4", OUT / "rescue.toml", *M4, ELFS / "rescue")
if sys.argv[4:]:
    scenario, elf, *wires = sys.argv[4:]
    wires = [word for wire in wires for word in ("--wire", wire)]
    for _ in range(2):
        measure("a sketch on an ATmega2560 at 16 MHz", scenario, "--board", "arduino-mega",
                "--firmware", elf, *wires)
