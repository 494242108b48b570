"""Judges the points that the sketch arduino.cpp printed.

usage: arduino.py NODE_PROGRAM_LOG
"""

import sys
from pathlib import Path

from rig import Turn

# A turn takes 0.18 s, the start of the next one waits for half a turn, and then it is printed.
TURNS_MIN = 6
# Points of a turn at 1.97 kHz and 5.5 turns a second are 358; some have no distance.
POINTS_MIN = 250


def main():
    # Of a long log the file has the end: it may begin within a turn.
    turns, points = [], None
    for line in Path(sys.argv[1]).read_text(encoding="utf-8").splitlines():
        words = line.removeprefix("serial: ").split()
        if words == ["turn"]:
            if points:
                turns.append(Turn(0, points))
            points = []
        elif len(words) == 2 and points is not None:
            angle_q6, distance_q2 = map(int, words)
            points.append((angle_q6 / 64, distance_q2 / 4))
    points = sum(turn.len for turn in turns)
    wrong = sum(turn.off for turn in turns)
    is_whole = all(turn.len >= POINTS_MIN for turn in turns)
    passed = wrong == 0 and is_whole and len(turns) >= TURNS_MIN
    verdict = "ok  " if passed else "FAIL"
    print(f"{verdict} arduino: {len(turns)} turns, {points} points, {wrong} wrong")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
