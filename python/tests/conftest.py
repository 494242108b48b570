import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from hilrig import find_binary

pytest_plugins = ["pytester", "hilrig.plugin"]

SOURCE = Path(__file__).parent.parent / "src"


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """A scenario of 20 s with a robot defined by data: two wheels, a lidar, a room."""
    path = tmp_path / "robot.toml"
    subprocess.run([find_binary(), "new", str(path), "--robot"], check=True, capture_output=True)
    return path


@pytest.fixture
def places(monkeypatch: pytest.MonkeyPatch):
    """The parent folder of rigs; a short path, because the name of a socket is limited."""
    with tempfile.TemporaryDirectory(prefix="h-") as folder:
        monkeypatch.setenv("TMPDIR", folder)
        yield Path(folder)


@pytest.fixture
def inner(pytester: pytest.Pytester, scenario: Path, monkeypatch: pytest.MonkeyPatch):
    """Runs pytest with the plugin on a test file next to the scenario."""
    (pytester.path / "robot.toml").write_text(scenario.read_text())
    monkeypatch.setenv("PYTHONPATH", str(SOURCE))

    def run(tests: str, *options: str) -> pytest.RunResult:
        pytester.makepyfile(test_inner=tests)
        words = [sys.executable, "-m", "pytest", "-p", "hilrig.plugin", *options]
        return pytester.run(*words)

    return run
