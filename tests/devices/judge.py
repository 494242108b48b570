"""Judges the described devices by public drivers, in virtual time.

    python judge.py [--all] [--write] [NAME ..]

Each row of devices.toml names a device, a driver and what is read. The driver's program runs

- once with nothing wrong: every value is as it was worked out by hand, no rule of the device is
  broken, the program ends with 0;
- 26 s with damaged bytes, lost bytes, silence and peace again: each value is sound, or the driver
  reports an error; in the end all values are sound;
- with --all, fuzzed by `hilrig fuzz`: made replies that are altered.

What a driver does otherwise is listed in its row and must happen exactly so. --write makes the table
of docs/devices.md of it; without, the table there must be the same. HILRIG is the command.
"""
import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
HILRIG = os.environ.get("HILRIG", str(ROOT / "target/debug/hilrig"))
PAGE = ROOT / "docs/devices.md"
BEGIN, END = "<!-- begin: made by tests/devices/judge.py -->\n", "<!-- end -->\n"
FAULTS = """
[[fault]]
kind = "flip"
link = "dev"
direction = "to-master"
rate = {rate}
from = "5s"
until = "10s"

[[fault]]
kind = "drop"
link = "dev"
direction = "to-master"
rate = {rate}
from = "10s"
until = "15s"

[[fault]]
kind = "device"
device = "dev"
fault = "off"
from = "15s"
until = "20s"
"""


# A busy machine stretches the wall clock: the limit of a run is processor time of each process. The
# limit of the wall clock only ends a run that waits forever.
CPU_MAX, WALL_MAX = 600, 7200


def run(words, **given):
    """Runs a command within the limits; its output is text."""
    def limit():
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_MAX, CPU_MAX + 10))
    done = subprocess.run(words, capture_output=True, text=True, timeout=WALL_MAX,
                          preexec_fn=limit, **given)
    if done.returncode == -signal.SIGXCPU:
        done.stderr += f"\nthe command needs more than {CPU_MAX} s of processor time\n"
    return done


def fits(found, expected):
    """Whether words are the expected ones, of which a..b is a range of numbers."""
    found, expected = found.split(" "), expected.split(" ")
    return len(found) == len(expected) and all(map(fits_word, found, expected))


def fits_word(found, expected):
    key, is_named, span = expected.rpartition("=")
    if is_named:
        found_key, _, found = found.rpartition("=")
        if found_key != key:
            return False
    least, is_span, most = span.partition("..")
    if not is_span:
        return found == span
    try:
        return float(least) <= float(found) <= float(most)
    except ValueError:
        return False


class Row:
    """A device with a driver."""

    def __init__(self, row):
        self.row = row
        self.name, self.device = row["driver"], row["device"]
        self.program = HERE / "drivers" / row["program"]
        self.expected = row["reads"]
        self.failures = []

    def fail(self, why):
        self.failures.append(why)
        print(f"  FAIL {self.name} at {self.device}: {why}", flush=True)

    def scenario(self, folder, duration, faults=""):
        units = self.row.get("units")
        if units:
            described = "[" + ", ".join(
                f'{{ file = "{ROOT}/devices/{self.device}.toml", name = "{name}", address = {address} }}'
                for name, address in units.items()) + "]"
        else:
            described = f'"{ROOT}/devices/{self.device}.toml"'
        text = (f'schema = 1\nname = "{self.device}"\nrobot = "none"\nduration = "{duration}s"\n'
                f"device.dev = {{ description = {described} }}\n{faults}")
        path = folder / "scenario.toml"
        path.write_text(text)
        return path

    def hilrig(self, folder, *words, mode):
        command = f"exec {sys.executable} {self.program}"
        return run(
            [HILRIG, *words, "--exec", command, "--virtual", "--out", str(folder / mode)],
            env={**os.environ, "MODE": mode, "PYTHONPATH": str(HERE / "drivers")})

    def lines(self, folder, mode):
        log = folder / mode / "program.log"
        text = log.read_text(errors="replace") if log.exists() else ""
        return [line for line in text.splitlines() if line]

    def reading(self, line):
        """The name and the value of a line that is a reading."""
        for name in sorted(self.expected, key=len, reverse=True):
            if line.startswith(name + " "):
                return name, line[len(name) + 1:]
        return None, line

    def plain(self, folder):
        done = self.hilrig(folder, "run", str(self.scenario(folder, 120)), "--exec-may-end",
                           "--exec-may-idle", mode="plain")
        if "program-alive             ended with exit code 0" not in done.stdout:
            self.fail("the driver's program failed\n" + done.stdout + done.stderr
                      + "\n".join(self.lines(folder, "plain")[-15:]))
        seen = []
        for line in self.lines(folder, "plain"):
            name, value = self.reading(line)
            if name is None:
                continue
            seen.append(name)
            if not fits(value, self.expected[name]):
                self.fail(f"{name} is {value!r}, expected {self.expected[name]!r}")
        if seen != list(self.expected):
            self.fail(f"read {seen}, expected {list(self.expected)}")
        result = folder / "plain" / "events.txt"
        events = result.read_text().splitlines() if result.exists() else []
        rules = {line.split()[2].rstrip(":") for line in events if len(line.split()) > 2}
        # A driver opens its port before it sets the rate; the others tell what the device does.
        rules -= {"port-opened", "port-closed", "wrong-baud", "restarted", "not-answered", "made-safe"}
        if rules != set(self.row.get("rules", [])):
            self.fail(f"rules broken: {sorted(rules)}, expected {self.row.get('rules', [])}")

    def faults(self, folder):
        if "faults" not in self.row:
            return None
        faults = FAULTS.format(rate=self.row.get("rate", 0.01))
        path = self.scenario(folder, 40, "" if "units" in self.row else faults)
        done = self.hilrig(folder, "run", str(path), "--exec-may-end", "--exec-may-idle",
                           mode="faults")
        sound = noticed = 0
        shown, last = set(), {}
        for line in self.lines(folder, "faults"):
            if line.startswith("noticed "):
                noticed += 1
            elif line.startswith("CRASH "):
                name, rest = self.reading(line[6:])
                shown.add(f"crash: {name}: {rest.split(':')[0]}")
                last[name] = False
            else:
                name, value = self.reading(line)
                if name is None:
                    continue
                is_sound = fits(value, self.expected[name])
                last[name] = is_sound
                if is_sound:
                    sound += 1
                elif value in ("None", "False", "None None"):
                    noticed += 1
                else:
                    shown.add(f"wrong: {name}")
        shown |= {f"not sound in the end: {name}" for name, is_sound in last.items() if not is_sound}
        if "program-alive             ended with exit code 0" not in done.stdout:
            shown.add("does not end")
        self.compare("faults", shown)
        return sound, noticed

    def fuzz(self, folder):
        if "fuzz" not in self.row:
            return None
        cases = self.row.get("cases", 4)
        path = self.scenario(folder, 20)
        done = self.hilrig(folder, "fuzz", "--scenario", str(path), "--link", "dev", "--cases",
                           str(cases), "--shrink", "0", mode="fuzz")
        report = folder / "fuzz" / "dut.json"
        if not report.exists():
            self.fail("no fuzz run\n" + done.stdout + done.stderr)
            return 0
        report = json.loads(report.read_text())
        shown = {re.sub(r" at .*", "", finding["key"]) for finding in report["findings"]}
        self.compare("fuzz", shown)
        return report["inputs"]

    def compare(self, what, shown):
        listed = set(self.row.get(what, []))
        for one in sorted(shown - listed):
            self.fail(f"{what}: {one}: not listed in devices.toml")
        # A fuzz run of another version may find less.
        for one in sorted(listed - shown if what == "faults" else ()):
            self.fail(f"{what}: {one}: listed in devices.toml, but did not happen")


def versions():
    files = [HERE / "requirements.txt", HERE / "alone.txt"]
    lines = [line for file in files for line in file.read_text().splitlines()]
    pairs = (line.split("==") for line in lines if "==" in line)
    return {name.lower(): version for name, version in pairs}


def table(results):
    known = versions()
    rows = ["| device | lines | driver | read without error | with damage, losses and silence "
            "| fuzzed |", "|---|---|---|---|---|---|"]
    for row, counts in results:
        lines = len((ROOT / "devices" / f"{row.device}.toml").read_text().splitlines())
        reads = ", ".join(row.expected)
        package = row.row.get("package", row.name)
        other = "; ".join(sorted(row.row.get("faults", []))).replace("|", "\\|")
        under = "-" if counts is None else f"{counts[0]} sound, {counts[1]} noticed"
        under += f"; {other}" if other else ""
        causes = "; ".join(sorted(row.row.get("fuzz", []))).replace("|", "\\|")
        fuzzed = "-" if "fuzz" not in row.row else f"{row.row.get('cases', 4)} cases"
        fuzzed += f"; {causes}" if causes else ""
        device = f"{row.device}" + (f" ({row.row['note']})" if "note" in row.row else "")
        rows.append(f"| {device} | {lines} | {package} {known[package.lower()]} | {reads} "
                    f"| {under} | {fuzzed} |")
    return "\n".join(rows) + "\n"


def main():
    words = sys.argv[1:]
    options = {word for word in words if word.startswith("--")}
    names = [word for word in words if not word.startswith("--")]
    rows = [Row(row) for row in tomllib.loads((HERE / "devices.toml").read_text())["driver"]]
    rows = [row for row in rows if not names or row.name in names or row.device in names]
    results = []
    for row in rows:
        with tempfile.TemporaryDirectory(prefix="hilrig-devices-") as folder:
            folder = Path(folder)
            row.plain(folder)
            # Reads alone at each landing; by name or with --all also what faults do.
            is_whole = "--all" in options or bool(names)
            counts = row.faults(folder) if is_whole else None
            inputs = row.fuzz(folder) if "--all" in options else None
            results.append((row, counts))
            said = "read" if counts is None else f"{counts[0]} sound, {counts[1]} noticed"
            print(f"{row.device}: {row.name}: {said}"
                  + ("" if inputs is None else f", {inputs} inputs"), flush=True)
    failed = sum(len(row.failures) for row in rows)
    if "--all" in options and not names and not failed:
        made = table(results)
        text = PAGE.read_text()
        before, rest = text.split(BEGIN)
        old, after = rest.split(END)
        if "--write" in options:
            PAGE.write_text(before + BEGIN + made + END + after)
        elif old != made:
            print("  FAIL docs/devices.md: the table is another one; judge.py --all --write")
            failed += 1
    print(f"{len(rows)} drivers, {len({row.device for row in rows})} devices, {failed} failures")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
