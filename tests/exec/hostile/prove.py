"""Programs that attack their supervisor, in virtual time.

    python3 prove.py [--seed N] [--first N] [--count N] [--jobs N] [--twice] [--verbose]
    python3 prove.py --words "WORDS" [--verbose]

Each case is a list of words for hostile.c: fork bombs, sessions, flags of clone, signals that are
ignored, blocked or sent, closed files, ptrace, exec, threads that end in odd orders, limits, calls of
32-bit programs, timers, memory. After each run:

- the supervisor has ended by itself, with exit code 0 or 1, and its result is there;
- no process of the program is left, and no port;
- the run has passed only if the program's first process said that it exits, or was alive in the end;
  a program that hangs, computes for ever, or ends with an error or a signal has not passed;
- a tame program, which harms nothing and exits with 0, has passed;
- with --twice a second run has the same verdict.

HILRIG is the command. Exit code 1: some case is wrong; its words repeat it.
"""
import argparse
import json
import os
import random
import shlex
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent.parent
HILRIG = os.path.realpath(os.environ.get("HILRIG", ROOT / "target/release/hilrig"))
RIG = (HERE.parent / "programs/sonar.toml").read_text().replace('"3s"', '"4s"')
# Wall time of a case, at a load of many. Virtual time may stand for 30 s before the run ends.
PATIENCE = 300

# Weights and words; a number is chosen from each list. Those of the first table do no harm to the
# process itself, so a program of them alone is tame.
TAME = [
    (4, "sleep", [1, 20, 100]), (2, "read", [1, 3]), (1, "write", [1, 50]), (1, "clock", [3, 2000]),
    (1, "yield", [3, 500]), (1, "compute", [1, 1000]), (1, "ignore", [1, 2, 10, 12, 13, 17, 34, 64]),
    (1, "handle", [1, 2, 10, 17, 34, 64], [0]), (1, "block", [1, 10, 17, 34, 64]), (1, "poll", [0, 5], [1, 30]),
    (1, "traceme"), (1, "int80", [20, 64]), (1, "socket", [0, 1], [0, 1]), (1, "wait", [0, 2]),
    (1, "setpgid"), (1, "break"), (1, "fault", [5]), (1, "stack", [3]), (1, "excl", [0, 1]),
    (1, "prctl", [1, 4, 15, 26, 36, 38], [0, 1, 2]),
]
WILD = [
    (2, "pipe", [0, 1], [0, 1]), (1, "empty"), (1, "lock"), (1, "pause"), (1, "spin"), (2, "ends"),
    (2, "leaves"), (3, "exit", [0, 0, 1, 3, 255]), (2, "ignore", [15, 15, 18, 19, 9]), (1, "block", [0]),
    (3, "raise", [1, 2, 6, 9, 10, 11, 15, 17, 18, 19, 20, 21, 31, 32, 34, 50, 64]),
    (2, "first", [2, 9, 11, 15, 18, 19, 34]), (1, "group", [1, 2, 15, 18, 19, 9]),
    (1, "unknown", range(4), [0, 9, 15, 34, 99]), (1, "setsid"),
    (2, "close", [0, 1, 2, 3, 4, 5]), (2, "closes"), (1, "attach", [0, 1]),
    (2, "limit", [0, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13], [0, 1, 8, 65536, 1 << 20]),
    (2, "alarm", [50, 1000, 30000], [0, 0, 1, 2]), (1, "timers", [1, 20], [50, 3000]),
    (3, "int80", [1, 2, 6, 29, 72, 190, 252, 7], [0, 1, 3, 5]), (2, "unmap", [0, 1]),
    (2, "map", [1, 100, 1 << 20], [0, 1]), (1, "stack", [300]), (2, "fault", [0, 1, 2, 3, 4]),
    (1, "handle", [10, 14, 34, 64], [1]), (1, "flags", [0, 1]), (1, "setuid", [65534]),
    (1, "unshare", [0x400, 0x200, 0x20000, 0x20000000, 0x8000000, 0x10000000]), (1, "read", [100]),
    (2, "page", range(6), range(4)), (1, "stackless", [4, 10, 11, 34, 64], range(6)), (1, "storm", range(4), [10, 17, 34, 64, 0, 99]),
    (3, "bad", [0, 1, 7, 16, 19, 20, 23, 35, 36, 38, 44, 45, 46, 47, 61, 96, 98, 99, 100, 128, 159, 202, 206,
                209, 220, 222, 223, 224, 228, 230, 232, 240, 242, 243, 247, 257, 262, 267, 270, 271, 281, 283,
                286, 287, 288, 299, 307, 318, 327, 328, 435, 437, 441, 449], range(6)),
    (1, "call", [0, 7, 13, 15, 35, 56, 57, 61, 72, 101, 127, 128, 130, 202, 219, 230, 247, 270, 281,
                 282, 283, 286, 289, 293, 317, 322, 425, 434, 435, 436, 439, 441, 449], [0, 1, -1, 4096]),
]
BLOCKS = [
    (4, "fork"), (1, "vfork"), (4, "thread"), (3, "clone", range(13), [0, 0, 1]), (1, "bomb", [3, 12, 25], [0, 1]),
    (2, "exec"), (2, "daemon"),
]


def chosen(chance, table):
    _, name, *lists = chance.choices(table, [weight for weight, *_ in table])[0]
    return ":".join([name, *(str(chance.choice(list(one))) for one in lists)])


def body(chance, depth, most, tables):
    words = []
    for _ in range(chance.randint(1, most)):
        if depth and chance.random() < 0.4:
            block = chosen(chance, BLOCKS)
            # Bombs are of few words, and none inside another.
            inner = 0 if block.startswith("bomb") else depth - 1
            words += [block, "{", *body(chance, inner, 1 if inner == 0 else 4, tables), "}"]
        else:
            words.append(chosen(chance, chance.choice(tables)))
    return words


def case(seed, number):
    """The words of a case, and whether it is tame."""
    chance = random.Random(f"{seed}.{number}")
    if chance.random() < 0.25:
        words = ["open", "read:2"]
        for _ in range(chance.randint(1, 6)):
            if chance.random() < 0.3:
                inner = [chosen(chance, TAME) for _ in range(chance.randint(1, 3))]
                words += [chance.choice(["fork", "clone:0:0", "clone:1:0"]), "{", *inner, "}", "wait"]
            else:
                words.append(chosen(chance, TAME))
        return words + ["wait", "exit:0"], True
    words = chance.choice([[], ["open"], ["open"], ["open", "read:2"], ["open:1"], ["open:2"]])
    words = words + body(chance, 3, 7, [TAME, WILD])
    return words + chance.choice([["exit:0"], ["exit:0"], ["exit:0"], ["wait:1"], ["read:100"], []]), False


def left(program, notes):
    """Processes of the case that are still there."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            state = (entry / "stat").read_text().rpartition(") ")[2][0]
            is_ours = f"HOSTILE_NOTES={notes}\0".encode() in (entry / "environ").read_bytes()
            if is_ours and state not in "ZX":
                found.append(f"{entry.name} ({state})")
        except (OSError, IndexError):
            continue
    return found


def judged(words, is_tame, program, folder, verbose=False):
    """What is wrong with a case, and how it ended."""
    notes = folder / "notes"
    (folder / "sonar.toml").write_text(RIG)
    command = shlex.join([str(program), *words])
    env = os.environ | {"HOSTILE_NOTES": str(notes)}
    run = subprocess.Popen(
        [HILRIG, "run", "sonar.toml", "--virtual", "--exec", f"exec {command}", "--exec-may-end",
         "--exec-may-idle", "--spin-max", "1s", "--out", "out"],
        cwd=folder, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, errors="replace",
    )
    try:
        said, _ = run.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        run.kill()
        run.communicate()
        return ["the supervisor hangs"], "hangs"
    wrong = [f"left behind: process {one}" for one in left(program, notes)]
    if (folder / "out/ports").exists():
        wrong.append("its ports are left")
    if verbose:
        print(said, notes.read_text() if notes.exists() else "no notes", sep="\n---\n")
    if run.returncode not in (0, 1):
        return wrong + [f"exit code {run.returncode}: {said[-600:]}"], "broken"
    try:
        result = json.loads((folder / "out/result.json").read_text())
    except (OSError, ValueError) as error:
        return wrong + [f"no result: {error}: {said[-600:]}"], "broken"
    alive = [check["detail"] for check in result["checks"] if check["name"] == "program-alive"]
    alive = alive[0] if alive else ""
    lines = notes.read_text().splitlines() if notes.exists() else []
    own = [line[6:] for line in lines if line.startswith("first ")]
    # A wait that came to its end says nothing of the process.
    ended = [word for word in own if word not in ("hangs", "goes on")]
    last = own[-1] if own and own[-1] != "goes on" else next(reversed(ended), "nothing")
    has_passed = run.returncode == 0
    # Whether a process hangs is seen at its port, unless another thread reads there or the port is
    # closed: it may rest.
    is_alive = alive.startswith("to the end") and (
        last in ("nothing", "reads") or any(line.endswith(" reads") for line in lines)
        or "closes" in words)
    if has_passed and not is_alive and last not in ("exits", "leaves", "thread ends"):
        wrong.append(f"has passed, though the first process {last}; {alive}")
    if has_passed and lines and lines[-1].endswith(" spins"):
        wrong.append("has passed, though it computes for ever")
    if is_tame and not has_passed:
        wrong.append(f"has failed, though it is tame: {said[-900:]}")
    if "panicked" in said:
        wrong.append(f"the supervisor panics: {said[-600:]}")
    return wrong, "passed" if has_passed else "failed"


def main():
    options = argparse.ArgumentParser()
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--count", type=int, default=1000)
    options.add_argument("--jobs", type=int, default=os.cpu_count())
    options.add_argument("--words")
    options.add_argument("--twice", action="store_true")
    options.add_argument("--verbose", action="store_true")
    options = options.parse_args()
    ended = {}
    bad = 0
    with tempfile.TemporaryDirectory() as work:
        program = Path(work) / "hostile"
        source = HERE / "hostile.c"
        subprocess.run(["cc", "-O1", "-pthread", "-o", program, source], check=True)

        def one(number):
            words, is_tame = case(options.seed, number)
            if options.words:
                words, is_tame = shlex.split(options.words), False
            folder = Path(work) / f"case-{number}"
            folder.mkdir()
            wrong, end = judged(words, is_tame, program, folder, options.verbose)
            if options.twice and not wrong:
                (folder / "notes").unlink(missing_ok=True)
                again, other = judged(words, is_tame, program, folder)
                wrong = again + ([f"has {end}, then {other}"] if other != end else [])
            subprocess.run(["rm", "-rf", folder], check=False)
            return number, words, wrong, end

        numbers = range(options.first, options.first + (1 if options.words else options.count))
        with ThreadPoolExecutor(options.jobs) as pool:
            for number, words, wrong, end in pool.map(one, numbers):
                ended[end] = ended.get(end, 0) + 1
                if wrong:
                    bad += 1
                    print(f"case {number}: {'; '.join(wrong)}\n  --words '{' '.join(words)}'", flush=True)
    table = ", ".join(f"{count} {end}" for end, count in sorted(ended.items()))
    print(f"{sum(ended.values())} hostile programs of seed {options.seed}: {bad} wrong ({table})")
    return bad > 0


if __name__ == "__main__":
    sys.exit(main())
