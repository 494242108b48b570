"""The pytest plugin: fixtures ``rig`` and ``device``, marker ``hilrig``, options ``--hilrig-*``.

::

    @pytest.mark.hilrig("scenarios/my-robot.toml")
    def test_it_stops_at_the_wall(rig):
        r = rig()
        lidar = serial.Serial(r.port("lidar"), 115200)
        ...
        assert r.wait({"pose": {"near_m": [2.2, 1.0], "within_m": 0.2}}, "30s")
        r.finish().assert_passed()

Each rig has its own directory, so tests may run in parallel. The result folder of a failed test is
kept; the report contains its path and the command that repeats the test.
"""

from __future__ import annotations

import hashlib
import re
import shlex
import shutil
from pathlib import Path
from typing import Any, Callable, Dict, Generator, List, Optional, Sequence, Tuple

import pytest

from .binary import find_binary
from .bench import Bench
from .result import Result
from .rig import Rig, Running, firmware, run
from .session import PathLike, RigError, Session, needed


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("hilrig", "rigs for robots")
    group.addoption(
        "--hilrig-virtual",
        action="store_true",
        help="run the programs of rig.run and rig.start in virtual time; a test that is the program "
        "itself stays in real time",
    )
    group.addoption(
        "--hilrig-seed", type=int, metavar="N", help="seed of all rigs, in place of their own"
    )
    group.addoption(
        "--hilrig-keep",
        metavar="DIR",
        default="hilrig-out/pytest",
        help="where the result folders of failed tests are kept (default: %(default)s)",
    )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        "hilrig(scenario, seed=None, options=()): what the fixture rig runs if it is not told",
    )
    if config.getoption("--hilrig-virtual"):
        try:
            needed(find_binary(), "run", "--virtual")
        except RuntimeError as error:
            raise pytest.UsageError(f"--hilrig-virtual: {error}") from error


class RigFactory:
    """The fixture ``rig``: starts rigs that end with the test."""

    def __init__(self, request: pytest.FixtureRequest) -> None:
        self._request = request
        self._rigs: List[Session] = []
        self._seeds: List[int] = []
        #: Result folders; removed after a passed test.
        self._folders: List[Path] = []

    def __call__(self, scenario: Optional[PathLike] = None, **settings: Any) -> Rig:
        """Starts a rig for ``scenario``, or for that of the marker; ``settings`` as for ``Rig``."""
        # A test that is the program itself runs in real time, so the rig must too.
        path, settings = self._settings(scenario, settings, is_virtual=False)
        rig = Rig(path, out=self._folder(), **settings)
        self._add(rig)
        return rig

    def _add(self, rig: Session) -> None:
        self._rigs.append(rig)
        self._seeds.append(rig.seed)

    def run(self, program: str, scenario: Optional[PathLike] = None, **settings: Any) -> Result:
        """Runs and judges a program in the folder of the test's file, see ``hilrig.run``."""
        path, settings = self._program_settings(scenario, settings)
        return self._ran(run(path, program, out=self._folder(), **settings))

    def firmware(
        self,
        elf: PathLike,
        board: str,
        scenario: Optional[PathLike] = None,
        **settings: Any,
    ) -> Result:
        """Runs and judges firmware on a simulated board, see ``hilrig.firmware``; the path ``elf``
        begins at the test's file."""
        path, settings = self._program_settings(scenario, settings)
        # It has no other time.
        settings.pop("virtual", None)
        return self._ran(firmware(path, elf, board, out=self._folder(), **settings))

    def _ran(self, result: Result) -> Result:
        runs = result.raw["result"]["runs"]
        self._seeds.extend(int(one["seed"]) for one in runs if one["seed"] is not None)
        return result

    def start(self, program: str, scenario: Optional[PathLike] = None, **settings: Any) -> Running:
        """Starts a program as ``run`` does; the test adds faults and waits while it runs."""
        path, settings = self._program_settings(scenario, settings)
        running = Running(path, program, out=self._folder(), **settings)
        self._add(running)
        return running

    def device(self, device: PathLike = "", **settings: Any) -> Bench:
        """Starts a rig with one device, see ``hilrig.Bench``; the path of a description begins at
        the test's file, and a program runs in its folder."""
        folder = Path(self._request.node.path).parent
        settings.setdefault("folder", folder)
        given = self._request.config.getoption("--hilrig-seed")
        if given is not None:
            settings["seed"] = given
        if device and (folder / device).is_file():
            device = folder / device
        bench = Bench(device, out=self._folder(), **settings)
        self._add(bench)
        return bench

    def _program_settings(
        self, scenario: Optional[PathLike], settings: Dict[str, Any]
    ) -> Tuple[PathLike, Dict[str, Any]]:
        is_virtual = bool(self._request.config.getoption("--hilrig-virtual"))
        path, settings = self._settings(scenario, settings, is_virtual)
        settings.setdefault("cwd", Path(self._request.node.path).parent)
        return path, settings

    def _settings(
        self, scenario: Optional[PathLike], given: Dict[str, Any], is_virtual: bool
    ) -> Tuple[PathLike, Dict[str, Any]]:
        settings: Dict[str, Any] = {}
        marker = self._request.node.get_closest_marker("hilrig")
        if marker is not None:
            settings.update(marker.kwargs)
            if len(marker.args) > 1:
                more = ", ".join(repr(argument) for argument in marker.args[1:])
                raise RigError(
                    f"@pytest.mark.hilrig has {more} behind its scenario: expected one scenario, "
                    "and settings by name, e.g. seed=5"
                )
            if marker.args:
                settings["scenario"] = marker.args[0]
        settings.update(given)
        if scenario is not None:
            settings["scenario"] = scenario
        path = settings.pop("scenario", None)
        if path is None:
            raise RigError('which scenario? rig("my.toml"), or @pytest.mark.hilrig("my.toml")')
        config = self._request.config
        if config.getoption("--hilrig-seed") is not None:
            settings["seed"] = config.getoption("--hilrig-seed")
        settings.setdefault("virtual", is_virtual)
        # A relative path starts at the test's file, else at the folder in which pytest was
        # started.
        beside = Path(self._request.node.path).parent / path
        return (beside if beside.exists() else Path(path)), settings

    def _folder(self) -> Path:
        """The next result folder of this test: empty, with the name of the test."""
        node = self._request.node.nodeid
        name = re.sub(r"[^A-Za-z0-9_.-]+", "-", node.rsplit("/", 1)[-1]).strip("-")[:80]
        # Without special characters two parametrised tests may have the same name.
        name += "-" + hashlib.sha256(node.encode()).hexdigest()[:6]
        name += f"-{len(self._folders)}" if self._folders else ""
        config = self._request.config
        folder = Path(config.rootpath) / str(config.getoption("--hilrig-keep")) / name
        shutil.rmtree(folder, ignore_errors=True)
        self._folders.append(folder)
        return folder

    def story(self) -> str:
        """The report of a failed test: result folders, and the command that repeats the test."""
        lines = [f"results: {folder}" for folder in self._folders]
        config = self._request.config
        words = ["python", "-m", "pytest", self._request.node.nodeid]
        if len(set(self._seeds)) == 1:
            words += ["--hilrig-seed", str(self._seeds[0])]
        if config.getoption("--hilrig-virtual"):
            words.append("--hilrig-virtual")
        where = f"cd {shlex.quote(str(config.rootpath))} && "
        lines.append("repeat with: " + where + " ".join(shlex.quote(word) for word in words))
        return "\n".join(lines)

    @property
    def was_used(self) -> bool:
        return bool(self._folders)

    def close(self, failed: bool) -> None:
        """Ends all rigs; keeps their results if the test failed."""
        errors: List[str] = []
        for rig in self._rigs:
            for step in [rig.keep_log, rig.close] if failed else [rig.close]:
                try:
                    step()
                except Exception as error:  # The other rigs must end, too.
                    errors.append(str(error))
        for folder in [] if failed else self._folders:
            shutil.rmtree(folder, ignore_errors=True)
        if errors:
            raise RigError("; ".join(errors))


def pytest_unconfigure(config: pytest.Config) -> None:
    """Removes the folder of results if it is empty, after the last worker has ended."""
    if hasattr(config, "workerinput"):
        return
    keep = Path(config.rootpath) / str(config.getoption("--hilrig-keep"))
    for folder in (keep, keep.parent):
        try:
            folder.rmdir()
        except OSError:
            break  # The folder is not empty.


_FACTORY = pytest.StashKey[RigFactory]()
_FAILED = pytest.StashKey[bool]()


@pytest.fixture
def rig(request: pytest.FixtureRequest) -> Generator[RigFactory, None, None]:
    """Starts rigs, each in its own directory; they end with the test."""
    factory = RigFactory(request)
    request.node.stash[_FACTORY] = factory
    yield factory
    factory.close(request.node.stash.get(_FAILED, False))


@pytest.fixture
def device(rig: RigFactory) -> Callable[..., Bench]:
    """Starts rigs with one device each: ``device("modbus-meter")``."""
    return rig.device


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, None]:
    outcome = yield
    report = outcome.get_result()
    factory = item.stash.get(_FACTORY, None)
    if report.failed and factory is not None and factory.was_used:
        item.stash[_FAILED] = True
        report.sections.append(("hilrig", factory.story()))


__all__: Sequence[str] = ["RigFactory", "device", "rig"]
