"""Twelve drivers with one defect each: the run fails and names the cause, and the case of its capture
is red with the defect and green without it.

    python3 tests/drivers/prove.py [--seeds N] [--write] [NAME..]

Each driver has a folder with its source, the scenario `scene.toml`, and what else that needs. The
word `broken` chooses the defect, `fixed` leaves it out. The table in docs/causes.md is made of
drivers.toml; --write writes it, otherwise it must be the same. HILRIG is the command. Needs cc and
rustc; what they make is in WORK, or a folder of its own.
"""
import argparse
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
PAGE = ROOT / "docs/causes.md"
HILRIG = os.environ.get("HILRIG", str(ROOT / "target/debug/hilrig"))
LANGUAGES = {".c": "C", ".py": "Python", ".rs": "Rust"}
BEGIN = "| defect | driver | probable cause |"


def table(drivers):
    rows = [BEGIN, "|---|---|---|"]
    for one in drivers:
        cause = f"`.. {one['cause']} ..`"
        if "also" in one:
            cause += f", `.. {one['also']} ..`"
        path = f"{one['name']}/{one['file']}"
        language = LANGUAGES[pathlib.Path(path).suffix]
        rows.append(f"| {one['kind']} | `{path}` ({language}) | {cause} |")
    return "\n".join(rows) + "\n"


def check_table(drivers, writes):
    page = PAGE.read_text()
    begin = page.index(BEGIN)
    length = len(page[begin:].split("\n\n")[0])
    new = page[:begin] + table(drivers).rstrip("\n") + page[begin + length:].rstrip("\n") + "\n"
    if writes:
        PAGE.write_text(new)
    elif new != page:
        return [f"{PAGE}: its table is another one than drivers.toml; write it with --write"]
    return []


def built(one, work):
    """The command that starts a driver; compiled first, if need be."""
    source = HERE / one["name"] / one["file"]
    target = work / one["name"] / "driver"
    target.parent.mkdir(parents=True, exist_ok=True)
    match source.suffix:
        case ".py":
            return f"exec python3 -ISB {source}"
        case ".c":
            command = ["cc", "-O1", "-Wall", "-Wno-unused-result", "-o", target, source]
        case ".rs":
            command = ["rustc", "--edition", "2024", "-C", "opt-level=1", "-o", target, source]
    subprocess.run(command, check=True)
    return f"exec {target}"


def hilrig(folder, *words):
    done = subprocess.run([HILRIG, *words], cwd=folder, stdin=subprocess.DEVNULL, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    return done.returncode, done.stdout


def flaws(one, command, seed, work):
    """What is not as it should be with one driver and one seed."""
    folder = work / one["name"] / str(seed)
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(HERE / one["name"], folder)
    who, broken, fixed = f"{one['name']}, seed {seed}", f"{command} broken", f"{command} fixed"
    code, said = hilrig(folder, "run", "scene.toml", "--seed", str(seed), "--virtual", "--exec",
                        broken, "--out", "out")
    causes = [line for line in said.splitlines() if "probable cause: " in line]
    if code != 1 or len(causes) != 1:
        return [f"{who}: expected a failure with its cause, exit code {code}\n{said}"]
    lacks = [one[key] for key in ("cause", "also") if one.get(key, "") not in causes[0]]
    if lacks:
        return [f"{who}: the cause lacks {lacks}\n{causes[0]}"]
    code, said = hilrig(folder, "case", "from", "out/capture.pcapng", "-o", "case.toml")
    if code != 0:
        return [f"{who}: no case\n{said}"]
    code, said = hilrig(folder, "case", "check", "case.toml", "--virtual", "--exec", broken,
                        "--exec", fixed)
    colors = [line.split()[0] for line in said.splitlines() if line.startswith(("red", "green"))]
    if code != 0 or colors != ["red", "green"]:
        return [f"{who}: the case is {colors}, expected red and green\n{said}"]
    return []


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("names", nargs="*")
    args = parser.parse_args()
    drivers = tomllib.loads((HERE / "drivers.toml").read_text())["driver"]
    found = check_table(drivers, args.write)
    chosen = [one for one in drivers if not args.names or one["name"] in args.names]
    given = os.environ.get("WORK")
    with tempfile.TemporaryDirectory() as fresh, ThreadPoolExecutor(os.cpu_count()) as pool:
        work = pathlib.Path(given or fresh).resolve()
        commands = list(pool.map(lambda one: built(one, work), chosen))
        jobs = [(one, command, seed, work) for seed in range(1, args.seeds + 1)
                for one, command in zip(chosen, commands)]
        for one in pool.map(lambda job: flaws(*job), jobs):
            found += one
    for flaw in found:
        print(flaw, file=sys.stderr)
    if found:
        sys.exit(f"{len(found)} of {len(jobs)} trials failed")
    print(f"{len(chosen)} drivers, {args.seeds} seeds: each cause is named, each case is red and green")


if __name__ == "__main__":
    main()
