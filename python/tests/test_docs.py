"""The programs in docs/connect.md and docs/python.md, unchanged."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hilrig
from conftest import SOURCE

DOCS = Path(__file__).parent.parent.parent / "docs"


def test_the_judged_robot_in_python(pytester: pytest.Pytester, monkeypatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(SOURCE))
    for name in ("robot.toml", "robot.py", "test_robot.py"):
        shutil.copy(DOCS / "connect" / name, pytester.path)
    lines = [(pytester.path / name).read_text().count("\n") for name in ("robot.py", "test_robot.py")]
    assert sum(lines) <= 40
    result = pytester.runpytest_subprocess("-p", "hilrig.plugin")
    result.assert_outcomes(passed=1)


def test_the_judged_robot_in_c(tmp_path: Path) -> None:
    program = tmp_path / "robot"
    source = DOCS / "connect" / "robot.c"
    subprocess.run(["cc", "-Wall", "-Wextra", "-Werror", "-o", program, source], check=True)
    result = hilrig.run(DOCS / "connect" / "robot.toml", str(program), out=tmp_path / "out")
    assert result.passed, result


def test_a_robot_that_does_not_look_fails(tmp_path: Path) -> None:
    """The mutant: 75 mm instead of 750 mm."""
    program = tmp_path / "robot.py"
    text = (DOCS / "connect" / "robot.py").read_text()
    program.write_text(text.replace("> 750", "> 75"))
    result = hilrig.run(
        DOCS / "connect" / "robot.toml", f"python3 {program}", out=tmp_path / "out"
    )
    assert {"waypoints-visited", "no-collision-at-speed"} & {c.name for c in result.failures}


def test_every_test_on_the_page_runs(pytester: pytest.Pytester, monkeypatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(SOURCE))
    page = DOCS / "python.md"
    first = DOCS.parent / "tests" / "ci" / "first_test.py"
    subprocess.run([sys.executable, first, page, pytester.path], check=True)
    for name in ("robot.toml", "robot.py"):
        shutil.copy(DOCS / "connect" / name, pytester.path)
    tests = re.findall(r"```python\n(.*?)```", page.read_text(), re.S)
    tests = [test for test in tests if "def test_" in test and "my_driver" not in test]
    for number, test in enumerate(tests):
        (pytester.path / f"test_{number}.py").write_text(test)
    # The first one is in its own file, too.
    words = [sys.executable, "-m", "pytest", "-p", "hilrig.plugin", "--hilrig-virtual"]
    pytester.run(*words).assert_outcomes(passed=len(tests) + 1)


def test_every_call_of_the_devices_on_the_page_runs(inner, pytester) -> None:
    page = (DOCS / "python.md").read_text()
    section = page.split("## A device without a scenario\n")[1].split("\n## ")[0]
    cells = re.findall(r"^\| (`.+?`) \|", section, re.M)
    calls = [call for cell in cells for call in re.findall(r"`(.+?)`", cell)]
    assert len(calls) == 6, calls
    # The working directory of pytest is not the test's folder.
    folder = pytester.mkdir("tests")
    shutil.copy(DOCS.parent / "nodes" / "examples" / "scale.py", folder)
    shutil.copy(DOCS.parent / "devices" / "modbus-meter.toml", folder / "meter.toml")
    test = "import pytest\n\n@pytest.mark.parametrize('call', [%s])\n" % ", ".join(map(repr, calls))
    test += "def test_call(device, call):\n    meter = device('modbus-meter')\n"
    test += "    found = eval(call)\n    bench = found if hasattr(found, 'ports') else meter\n"
    test += "    assert bench.state()['time_ns'] > 0 and bench.finish().checks is not None\n"
    (folder / "test_calls.py").write_text(test)
    words = [sys.executable, "-m", "pytest", "-p", "hilrig.plugin", "tests"]
    pytester.run(*words).assert_outcomes(passed=len(calls))


def test_the_scale_of_the_page_is_weighed_and_fails_as_it_says(tmp_path: Path) -> None:
    page = (DOCS / "device-program.md").read_text()
    scale, drive, typed, motors = re.findall(r"```python\n(.*?)```", page, re.S)
    compile(motors, "drive.py", "exec")
    scenario = re.findall(r"```toml\n(.*?)```", page, re.S)[0]
    examples = DOCS.parent / "nodes" / "examples"
    assert scale == (examples / "scale.py").read_text()
    assert typed == (examples / "typed_scale.py").read_text()
    assert sum(1 for line in scale.splitlines() if line) == 25
    for name, text in [("scale.py", scale), ("drive.py", drive), ("scale.toml", scenario)]:
        (tmp_path / name).write_text(text)
    program = f"python3 {tmp_path / 'drive.py'}"
    out = tmp_path / "out"
    result = hilrig.run(tmp_path / "scale.toml", program, out=out, virtual=True, may_end=True)
    assert result.passed, result
    said = (out / "program.log").read_text().splitlines()
    assert said == ["b'S S     100.25 g\\r\\n'", "b'ZI S\\r\\n'", "b'S S       0.00 g\\r\\n'"]
    wrong = scale.replace('settings["load_g"]', 'settings["load_kg"]')
    (tmp_path / "scale.py").write_text(wrong)
    result = hilrig.run(tmp_path / "scale.toml", program, out=out, virtual=True, may_end=True)
    [failed] = [check for check in result.failures if check.name == "node-programs"]
    assert failed.detail.startswith("scale exited (exit code 1) before it answered an exchange")
    assert failed.detail.endswith("its last words: KeyError: 'load_kg'")
