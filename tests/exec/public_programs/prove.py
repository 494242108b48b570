"""Runs public programs, unmodified, in virtual time.

    python prove.py [--write] [--runs N] [NAME ..]

Each row of programs.toml is run N times (three): the program prints what its row says, the runs
have one trace and one output, and the table tells how many times faster than real time they were, by
the processor time of program and supervisor together. --write makes the table of docs/virtual-time.md;
with names, their rows of it.
HILRIG is the command, TOOLS the folder of the Python environment, BIN where programs are built.
"""
import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent.parent
PAGE = ROOT / "docs/virtual-time.md"
BEGIN, END = "<!-- begin: made by tests/exec/public_programs/prove.py -->\n", "<!-- end -->\n"
HILRIG = os.path.realpath(os.environ.get("HILRIG", ROOT / "target/release/hilrig"))
TOOLS = os.path.realpath(os.environ.get("TOOLS", ROOT / "target/public-programs"))
BIN = os.path.realpath(os.environ.get("BIN", ROOT / "target/public-programs/built"))
DESCRIBED = """
schema = 1
name = "{rig}"
robot = "none"
duration = "12s"
device.dev = {{ description = "{rig}" }}
"""


def scenario(rig):
    own = HERE / f"rigs/{rig}.toml"
    return own.read_text() if own.exists() else DESCRIBED.format(rig=rig)


def used():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def once(row, folder):
    """Trace, output, simulated seconds, processor seconds, and all that hilrig says."""
    folder.mkdir()
    (folder / "rig.toml").write_text(scenario(row["rig"]))
    for device in (HERE / "rigs").glob("*.device.toml"):
        (folder / device.name).write_text(device.read_text())
    (folder / "program.sh").write_text(
        'export P="$HILRIG_PORT_DEV" T="$HILRIG_TTY_DEV"\n' + row["command"] + "\n"
    )
    env = os.environ | {
        "HERE": str(HERE),
        "BIN": BIN,
        "PATH": f"{TOOLS}/bin:{os.environ['PATH']}" if row.get("pip") else os.environ["PATH"],
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONHASHSEED": "0",
        "LC_ALL": "C.UTF-8",
        "TZ": "UTC",
    }
    before = used()
    said = subprocess.run(
        [HILRIG, "run", "rig.toml", "--virtual", "--exec", "exec bash program.sh", "--out", "out",
         "--exec-may-end", "--exec-may-idle"],
        cwd=folder, env=env, capture_output=True, text=True, timeout=600,
    )
    said = said.stdout + said.stderr
    cost = used() - before
    trace = re.search(r"^ *trace ([0-9a-f]+)$", said, re.M)
    simulated = re.search(r"([0-9.]+) s simulated", said)
    log = folder / "out/program.log"
    output = log.read_text(errors="replace") if log.exists() else ""
    return (trace[1] if trace else "", output,
            float(simulated[1]) if simulated else 0.0, cost, said)


def tried(row, runs, verbose):
    """What became of a row: the words of the table, and what is wrong."""
    wrong = []
    with tempfile.TemporaryDirectory() as work:
        # Always the same path: it is in variables, and so in the program's memory.
        found = []
        for number in range(runs):
            folder = Path(work) / "run"
            found.append(once(row, folder))
            subprocess.run(["rm", "-rf", folder], check=True)
    output, said = found[0][1], found[0][4]
    if verbose:
        print(output[-1500:], said[-1500:], sep="\n---\n")
    if "refused" in row:
        if not re.search(row["refused"], output + said):
            wrong.append(f"is not refused with {row['refused']}")
        return f"refused: {row['why']}", "", "", wrong
    for wanted in row["reads"]:
        if not re.search(wanted, output, re.M):
            wrong.append(f"does not print {wanted}")
    traces = len({trace for trace, *_ in found})
    outputs = len({output for _, output, *_ in found})
    if traces != 1:
        wrong.append(f"{traces} traces")
    if not all(trace for trace, *_ in found):
        wrong.append("a run has no trace")
    if outputs != 1 and not row.get("own_numbers"):
        wrong.append(f"{outputs} outputs")
    fastest = min(cost for *_, cost, _ in found)
    speed = found[0][2] / fastest if fastest else 0
    differs = row.get("own_numbers", "outputs differ")
    same = "one trace, one output" if outputs == 1 else f"one trace; {differs}"
    notes = re.findall(r"leaves virtual time: (.*)", re.sub(r"/proc/\d+", "/proc/N", said))
    note = "; ".join(dict.fromkeys(notes))
    return same, f"{speed:.0f}" if speed >= 2 else f"{speed:.1f}", note, wrong


def main():
    words = argparse.ArgumentParser()
    words.add_argument("--write", action="store_true")
    words.add_argument("--runs", type=int, default=3)
    words.add_argument("--verbose", action="store_true")
    words.add_argument("names", nargs="*")
    words = words.parse_args()
    all_rows = tomllib.loads((HERE / "programs.toml").read_text())["program"]
    rows = [row for row in all_rows if not words.names or row["name"].split()[0] in words.names]
    os.makedirs(BIN, exist_ok=True)
    table, failed = {}, 0
    for row in rows:
        if "build" in row:
            env = os.environ | {"HERE": str(HERE), "BIN": BIN}
            command = ["sh", "-c", row["build"]]
            built = subprocess.run(command, env=env, capture_output=True, text=True)
            if built.returncode:
                print(f"FAIL {row['name']}: is not built: {built.stderr[:500]}", flush=True)
                failed += 1
                continue
        try:
            same, speed, note, wrong = tried(row, words.runs, words.verbose)
        except subprocess.TimeoutExpired:
            same, speed, note, wrong = "", "", "", ["takes more than 10 minutes"]
        print(f"{'FAIL ' if wrong else ''}{row['name']}: {same}, {speed} times real time"
              f"{', ' + '; '.join(wrong) if wrong else ''}", flush=True)
        failed += bool(wrong)
        table[row["name"]] = f"| {row['name']} | {same} | {speed} | {note} |\n"
    if words.write:
        head = "| program | three runs | times real time | leaves virtual time |\n|---|---|---|---|\n"
        page = PAGE.read_text()
        before, rest = page.split(BEGIN)
        old, after = rest.split(END)
        # Programs that were not run now keep their rows.
        kept = {line.split(" | ")[0][2:]: line for line in old.splitlines(keepends=True)}
        table = kept | table
        table = "".join(table[row["name"]] for row in all_rows if row["name"] in table)
        PAGE.write_text(before + BEGIN + head + table + END + after)
    return failed > 0


if __name__ == "__main__":
    sys.exit(main())
