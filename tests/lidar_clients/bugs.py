"""Runs the bugs of docs/test-your-lidar-driver.md, with the very lines that stand there, against
drivers of others, and says what becomes of each.

usage: bugs.py [--quick] [NUMBER..]

Prints the table of the page. With --quick only some are run, and must come out as the page has it.
"""

import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from rig import HERE, Rig

PAGE = HERE.parent.parent / "docs" / "test-your-lidar-driver.md"
NAMES = ("sdk", "rs", "roboticia", "adafruit")
# Each half of it a session where the bug needs a stop.
SECONDS = 10
# Those that neither chance nor a slow machine changes.
QUICK = (5, 17)
# What a bug needs of the drivers besides the lines.
SESSIONS = {2: 2, 6: 2}
KILLED_BEFORE = 11
LIMITED = 21
EXPRESS = 18
# Half of the time nothing is seen, and a turn has few points or none.
DARK = 16
# By its own choice the crate takes the typical mode; of an express scan it has the angles wrong.
OWN_CHOICE = (1, 14, 15, EXPRESS)


def bugs():
    """Number, title and lines of each bug of the page."""
    text = PAGE.read_text(encoding="utf-8")
    section = re.compile(r"^### (\d+) (.+?)\n.*?```toml\n(.*?)```", re.MULTILINE | re.DOTALL)
    return {int(number): (title, lines) for number, title, lines in section.findall(text)}


def table():
    """What the page says of each bug."""
    text = PAGE.read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| (.+) \|$", text, re.MULTILINE)
    return {int(number): cells.split(" | ") for number, cells in rows}


def options_of(number, name):
    options = {"sessions": SESSIONS[number]} if number in SESSIONS else {}
    if name == "rs" and number not in OWN_CHOICE:
        options["mode"] = 0
    if name == "roboticia" and number == EXPRESS:
        options["mode"] = "express"
    if number == LIMITED and name in ("roboticia", "adafruit"):
        options["buffer"] = {"roboticia": 600, "adafruit": 500}[name]
    return options


def word(outcome, number):
    """What became of a client, in a word or two."""
    end = outcome.end()

    def right(turn):
        return turn.off == 0 if number == DARK else turn.right

    if outcome.code is None:
        return "hangs"
    if outcome.code != 0:
        # Which one is said depends on the bits at that place.
        torn = "^(New scan flags mismatch|Check bit not equal to 1)$"
        error = re.sub(torn, "torn node", outcome.error)
        return f"ends: {error}"
    if not end or end[-1].at < outcome.ended_at - 2:
        told = "passed over" in outcome.talk
        return "silence, told" if told else "silence"
    if all(right(turn) for turn in outcome.turns[1:]):
        return "sound"
    return "recovers" if all(right(turn) for turn in end) else "wrong"


def run(number, lines, name):
    options = options_of(number, name)
    with Rig(lines) as rig:
        if number == KILLED_BEFORE:
            rig.run(name, SECONDS, kill_after=5, **options)
        outcome = rig.run(name, SECONDS, **options)
    return word(outcome, number) + (" (machine too slow)" if rig.starved else ""), outcome


def main():
    quick = "--quick" in sys.argv
    wanted = [int(number) for number in sys.argv[1:] if number.isdecimal()]
    known, said, failed = bugs(), table(), 0
    assert sorted(known) == list(range(1, 26)), f"the page has the bugs {sorted(known)}"
    numbers = wanted or (QUICK if quick else sorted(known))
    with ThreadPoolExecutor(len(NAMES)) as pool:
        for number in numbers:
            lines = known[number][1]
            found = list(pool.map(lambda name: run(number, lines, name), NAMES))
            words = [word for word, _ in found]
            print(f"| {number} | {' | '.join(words)} |", flush=True)
            if quick and said.get(number) != words:
                failed += 1
                print(f"FAIL the page says {said.get(number)}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
