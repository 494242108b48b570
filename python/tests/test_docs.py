"""The programs of docs/connect.md and docs/python.md, as they stand there."""

import re
import shutil
import subprocess
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
    """The mutant: 750 mm become 75."""
    program = tmp_path / "robot.py"
    text = (DOCS / "connect" / "robot.py").read_text()
    program.write_text(text.replace("> 750", "> 75"))
    result = hilrig.run(
        DOCS / "connect" / "robot.toml", f"python3 {program}", out=tmp_path / "out"
    )
    assert {"waypoints-visited", "no-collision-at-speed"} & {c.name for c in result.failures}


def test_every_test_on_the_page_runs(inner, pytester: pytest.Pytester) -> None:
    page = (DOCS / "python.md").read_text()
    tests = [block for block in re.findall(r"```python\n(.*?)```", page, re.S) if "serial" in block]
    assert tests
    inner("\n".join(tests)).assert_outcomes(passed=len(tests))
