"""Judges the emulated RPLIDAR A1 by clients of others: `hilrig up` on pseudo-terminals, each client
in its modes, right ranges and no error; then a byte is lost.

usage: judge.py SECONDS [vendor]    of scan a client; HILRIG and LIDAR_CLIENT_RS name the programs

With the word vendor: the vendor's own clients alone, which VENDOR_SDK and ROS_NODE name.
"""

import os
import re
import sys
from concurrent.futures import ThreadPoolExecutor

from rig import Rig, is_distance

# Client, what it runs on, its options. The vendor's SDK leaves no choice of the mode: it takes the
# one that the sensor calls typical, the express scan, also on 1.20, of which it asks the sample
# rate. So its other modes are chosen by what the sensor says: the number behind the plus.
STANDARD = "+0"
SOUND = [
    ("sdk", "fw1.20", {}),
    ("sdk", "fw1.24", {}),
    ("sdk", "fw1.29", {}),
    ("sdk", "fw1.29" + STANDARD, {}),
    ("sdk", "fw1.29+1", {}),
    ("sdk", "fw1.29+2", {}),
    ("sdk", "fw1.29+3", {}),
    ("sdk", "fw1.29+4", {}),
    ("rs", "fw1.24", {"mode": 0}),
    ("rs", "fw1.29", {"mode": 0}),
    ("roboticia", "fw1.20", {}),
    ("roboticia", "fw1.29", {}),
    ("adafruit", "fw1.20", {}),
    ("adafruit", "fw1.29", {}),
]
# The vendor's own programs, built by vendor.sh: its SDK for C++ and its ROS node, in each mode of
# firmware 1.29.
MODES = ["Standard", "Express", "Boost", "Sensitivity", "Stability"]
VENDORS = [("vendor", "fw1.29", {"mode": mode}) for mode in range(len(MODES))]
VENDORS += [("ros", "fw1.29", {"mode": mode}) for mode in MODES]
# Clients that read the angles of capsules wrongly, from any sender: this crate shifts the offset
# where the vendor's code shifts the difference; rplidar-roboticia takes the offset for signed.
ANGLES_WRONG = [
    ("rs", "fw1.24", {}),
    ("roboticia", "fw1.29", {"mode": "express"}),
]
# After a lost byte: what a client does.
LOST = [
    ("sdk", {}, "goes on"),
    # It checks neither S and its inverse nor C.
    ("rs", {"mode": 0}, "goes on with nonsense"),
    ("rs", {}, "sync 1|checksum"),
    ("roboticia", {}, "New scan flags mismatch|Check bit not equal to 1"),
    ("adafruit", {}, "New scan flags mismatch|Check bit not equal to 1"),
]
# 7.36 turns a second on the adapter. Half of them are enough: the rig's time stands when the machine
# is late, and the head needs 1.7 s to run up.
TURNS_PER_S = 7.36
# The byte that is lost: about two seconds of scan.
LOST_BYTE = """
[[fault]]
kind = "drop"
link = "lidar"
direction = "to-master"
byte = 20001
"""
# Rig and client need a processor for themselves.
AT_ONCE = os.cpu_count() or 1
# Another mode is called the typical one.
TYPICAL = """

[[fault]]
kind = "device"
device = "lidar"
fault = "typical-mode"
factor = {mode}
"""


def device(profile):
    firmware, _, mode = profile.partition("+")
    typical = TYPICAL.format(mode=mode) if mode else ""
    return f'[device.lidar.rplidar]\nprofile = "{firmware}"{typical}'


def label(name, *words, **options):
    return " ".join([name, *words, *(f"{key}={value}" for key, value in options.items())])


def figures(turns):
    """The first turn of a client may begin anywhere."""
    points = sum(turn.len for turn in turns)
    wrong = [turn for turn in turns[1:] if not turn.right]
    off = sum(turn.off for turn in wrong)
    return f"{len(turns)} turns, {points} points, {len(wrong)} turns wrong by {off} points", wrong


def sound(case, seconds):
    """A client on a sound sensor: no error, all turns right."""
    name, profile, options = case
    with Rig(device(profile)) as rig:
        outcome = rig.run(name, seconds, **options)
    words, wrong = figures(outcome.turns)
    enough = len(outcome.turns) >= TURNS_PER_S * (seconds - 2) / 2
    passed = outcome.code == 0 and not wrong and enough
    if name == "sdk":
        passed = passed and is_express(outcome.turns) != profile.endswith(STANDARD)
    return passed, label(name, profile, **options), words, (outcome, rig)


def is_express(turns):
    """Whether turns have 534 points, 4,000 a second, and not 267."""
    lengths = sorted(turn.len for turn in turns)
    return lengths[len(lengths) // 2] > 400


def angles_wrong(case, seconds):
    """As above, only that the client has the angles wrong: each distance is one of the room's."""
    name, profile, options = case
    with Rig(device(profile)) as rig:
        outcome = rig.run(name, seconds, **options)
    words, wrong = figures(outcome.turns)
    points = [point for turn in outcome.turns for point in turn.points]
    enough = len(outcome.turns) >= TURNS_PER_S * (seconds - 2) / 2
    passed = outcome.code == 0 and wrong and enough and all(is_distance(mm) for _, mm in points)
    return bool(passed), label(name, profile, **options), f"{words}, distances right", (outcome, rig)


def lost_byte(case, seconds):
    """One byte is lost."""
    name, options, expected = case
    with Rig(device("fw1.29") + LOST_BYTE) as rig:
        outcome = rig.run(name, seconds, **options)
    words, wrong = figures(outcome.turns)
    if expected == "goes on":
        passed = outcome.code == 0 and len(wrong) <= 2 and all(t.right for t in outcome.end())
    elif expected == "goes on with nonsense":
        passed = outcome.code == 0 and wrong and not any(t.right for t in outcome.end())
    else:
        passed = outcome.code not in (0, None) and re.search(expected, outcome.error)
        words = f"stops: {outcome.error}"
        expected = "stops"
    return bool(passed), label(name, **options) + " after a lost byte", words, (outcome, rig)


def main():
    seconds = float(sys.argv[1])
    jobs = [(sound, case) for case in SOUND]
    jobs += [(angles_wrong, case) for case in ANGLES_WRONG]
    jobs += [(lost_byte, case) for case in LOST]
    if sys.argv[2:] == ["vendor"]:
        jobs = [(sound, case) for case in VENDORS]
    failed = 0
    with ThreadPoolExecutor(AT_ONCE) as pool:
        for passed, what, words, (outcome, rig) in pool.map(lambda job: job[0](job[1], seconds), jobs):
            print(f"{'ok  ' if passed else 'FAIL'} {what}: {words}", flush=True)
            if not passed:
                failed += 1
                if rig.starved:
                    print("     the machine is too slow: bytes were lost, the client did not read")
                print(f"     exit code {outcome.code}; it said:\n{outcome.talk}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
