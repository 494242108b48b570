"""Shows the defects of trophies.toml again, in virtual time.

    python trophies.py [--write] [NUMBER ..]

--write makes docs/trophies.md of the file; without, the page there must be the same. With numbers the
commands and what the programs print are shown. HILRIG is the command.
"""
import os
import re
import sys
import tempfile
import tomllib
from pathlib import Path

from judge import HERE, HILRIG, ROOT, run, versions

PAGE = ROOT / "docs/trophies.md"
BEGAN = "import os, time\nBEGAN = time.monotonic()\nPORT = os.environ['HILRIG_DIR'] + '/dev'\n"


def fault(text):
    """A fault of the scenario, of `key = value` after `key = value`."""
    if not text:
        return ""
    keys = re.sub(r' (?=[a-z_]+ = )', "\n", text)
    link = "" if 'kind = "device"' in keys else 'link = "dev"\ndirection = "to-master"\n'
    return f"\n[[fault]]\n{keys}\n{link}"


def scenario(trophy, description):
    return (f'schema = 1\nname = "trophy"\nrobot = "none"\nduration = "{trophy.get("duration", 40)}s"\n'
            f'device.dev = {{ description = "{description}" }}\n{fault(trophy["faults"])}')


def show(number, trophy, is_told):
    with tempfile.TemporaryDirectory(prefix="hilrig-trophy-") as folder:
        folder = Path(folder)
        description = ROOT / "devices" / f"{trophy['device']}.toml"
        if "settings" in trophy:
            text = description.read_text()
            for old, new in trophy["settings"].items():
                assert old in text, f"{trophy['device']}: there is no {old}"
                text = text.replace(old, new)
            description = folder / description.name
            description.write_text(text)
        (folder / "scenario.toml").write_text(scenario(trophy, description))
        (folder / "program.py").write_text(BEGAN + trophy["program"])
        command = f"exec {sys.executable} {trophy.get('options', '')} {folder}/program.py"
        words = [HILRIG, "run", str(folder / "scenario.toml"), "--virtual", "--exec-may-end",
                 "--exec-may-idle", "--exec", command, "--out", str(folder / "out")]
        done = run(words)
        log = folder / "out" / "program.log"
        said = log.read_text(errors="replace") if log.exists() else done.stderr
        is_shown = re.search(trophy["shows"], said, re.MULTILINE) is not None
        has_ended = "ended with exit code" in done.stdout
        if trophy.get("hangs"):
            is_shown = is_shown and not has_ended and "returned" not in said
        print(f"{number}: {trophy['package']}: {'shown' if is_shown else 'NOT SHOWN'}", flush=True)
        if is_told or not is_shown:
            print(" ".join(words), (folder / "scenario.toml").read_text(), said, sep="\n")
        return is_shown


def page(trophies):
    known = versions()
    packages = {trophy["package"] for trophy in trophies}
    text = f"""# Defects found in published drivers

hilrig ran public drivers with the [described devices](devices.md) in virtual time, with damaged and lost bytes,
late replies and silence. This page shows {len(trophies)} defects of {len(packages)} packages. Each defect was also
located in the driver's code. Most of these drivers work well as long as the device works well. The page helps their
authors and users, and shows which defects such a run finds.

```console
$ bash tests/devices/run.sh                       # installs the drivers
$ target/device-drivers/bin/python tests/devices/trophies.py 5     # shows the fifth
```

Each defect has a scenario of one described device and at most one fault:

```toml
schema = 1
name = "trophy"
robot = "none"
duration = "40s"
device.dev = {{ description = "sds011" }}

[[fault]]
kind = "insert"
byte = 15
value = 0
link = "dev"
direction = "to-master"
```

```console
$ hilrig run scenario.toml --virtual --exec-may-end --exec 'python3 program.py'
```

"""
    for number, trophy in enumerate(trophies, 1):
        name = trophy["package"]
        keys = re.sub(r' (?=[a-z_]+ = )', ", ", trophy["faults"])
        text += (f"## {number}. {name} {known[name.lower()]}\n\n{trophy['what']}.\n\n"
                 f"- Device: `{trophy['device']}`; "
                 + (f"fault: `{keys}`" if keys else "no fault") + "\n"
                 + "".join(f"- Change in the description: `{new}` instead of `{old}`\n"
                           for old, new in trophy.get("settings", {}).items())
                 + f"- Where: {trophy['where']}\n- Right: {trophy['right']}\n\n"
                 f"```python\n{trophy['program'].strip()}\n```\n\n")
    return text.rstrip() + "\n"


def main():
    words = sys.argv[1:]
    numbers = [int(word) for word in words if word.isdigit()]
    trophies = tomllib.loads((HERE / "trophies.toml").read_text())["trophy"]
    made = page(trophies)
    failed = 0
    if "--write" in words:
        PAGE.write_text(made)
    elif not PAGE.exists() or PAGE.read_text() != made:
        print("FAIL docs/trophies.md: the page is another one; trophies.py --write")
        failed += 1
    for number, trophy in enumerate(trophies, 1):
        if not numbers or number in numbers:
            failed += not show(number, trophy, bool(numbers))
    print(f"{len(numbers) or len(trophies)} trophies, {failed} failures")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
