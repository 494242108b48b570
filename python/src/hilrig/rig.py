"""A running rig: its ports, faults, conditions and verdict."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Type, Union

from .binary import find_binary, knows, version
from .control import Control
from .result import Check, Result

#: A path.
PathLike = Union[str, "os.PathLike[str]"]
#: Timeout for the start and the end of a rig, wall time in seconds.
PATIENCE = 30.0


class RigError(RuntimeError):
    """The rig did not start, or did not end correctly; contains the reason."""


class Fault:
    """An active fault; ``end`` or the end of a ``with`` block ends it."""

    def __init__(self, control: Control, number: int) -> None:
        self._control = control
        #: Number of the fault, as in ``hilrig fault list``.
        self.number = number
        self._is_over = False

    def end(self) -> None:
        """Ends the fault now."""
        if not self._is_over:
            self._is_over = True
            self._control.ask("end", id=self.number)

    def __enter__(self) -> "Fault":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


class Rig:
    """``hilrig up`` with a scenario, in its own directory.

    The rig ends together with this process, even after a kill: it watches a pipe to this process.
    """

    def __init__(
        self,
        scenario: PathLike,
        *,
        seed: Optional[int] = None,
        virtual: bool = False,
        out: Optional[PathLike] = None,
        options: Sequence[str] = (),
        binary: Optional[str] = None,
    ) -> None:
        """Starts the rig; ``out`` is the result folder, ``options`` are added to ``hilrig up``."""
        self._binary = binary or find_binary()
        # A short path: the name of a Unix socket has at most 107 bytes.
        self._work = Path(tempfile.mkdtemp(prefix="hilrig-"))
        #: Directory of the ports.
        self.dir = self._work / "ports"
        #: Result folder; written when the rig ends.
        self.out = Path(out) if out is not None else self._work / "out"
        self._result: Optional[Result] = None
        words = [self._binary, "up", os.fspath(scenario), "--dir", str(self.dir)]
        # The result folder contains the case; another copy in the working directory is not needed.
        words += ["--out", str(self.out), "--case", str(self._work / "up.toml")]
        words += ["--until-eof", "--json", *options]
        words += [] if seed is None else ["--seed", str(seed)]
        words += _virtual(self._binary, "up") if virtual else []
        #: The command that was started.
        self.command = words
        self._log = (self._work / "hilrig.log").open("w+", encoding="utf-8")
        try:
            # In its own session: after a signal to pytest's process group the rig must still
            # remove its ports.
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log,
                text=True,
                start_new_session=True,
            )
        except OSError as error:
            self._clean()
            raise RigError(f"{self._binary} cannot be started: {error}") from error
        try:
            self._control = self._connect()
        except BaseException:
            self._kill()
            self._clean()
            raise
        #: Paths of the ports by name.
        self.ports: Dict[str, str] = {
            str(port["name"]): str(port["path"]) for port in self._control.greeting["ports"]
        }
        #: Seed of all randomness.
        self.seed: int = int(self._control.greeting["seed"])

    def _connect(self) -> Control:
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                return Control(self.dir)
            except OSError as error:
                if self._process.poll() is not None:
                    raise RigError(f"hilrig ended at once:\n{self.log()}") from error
                if time.monotonic() > deadline:
                    raise RigError(f"hilrig does not answer:\n{self.log()}") from error
            time.sleep(0.01)

    def port(self, name: str) -> str:
        """The path of a port, to be opened like any serial port."""
        if name not in self.ports:
            known = ", ".join(self.ports)
            raise KeyError(f"there is no port {name!r}, expected one of {known}")
        return self.ports[name]

    def log(self) -> str:
        """The output of the rig so far."""
        self._log.flush()
        return (self._work / "hilrig.log").read_text(encoding="utf-8", errors="replace")

    def fault(self, link: Optional[str] = None, **keys: Any) -> Fault:
        """Adds a fault as in a scenario: ``fault("base", direction="to-device", kind="cut")``.

        Append ``_`` to a key that is a Python keyword: ``from_``.
        """
        fault = {key.rstrip("_"): value for key, value in keys.items()}
        if link is not None:
            fault["link"] = link
        return Fault(self._control, int(self._control.ask("add", fault=fault)["id"]))

    def wait(self, condition: Mapping[str, Any], timeout: str = "10s") -> bool:
        """Waits until ``condition`` holds (docs/control.md); ``timeout`` is virtual time."""
        answer = self._control.ask("wait", **{"for": dict(condition)}, timeout=timeout)
        return bool(answer["held"])

    def state(self) -> Dict[str, Any]:
        """The current state of the robot."""
        return self._control.ask("state")

    def mission(self, action: Union[str, Mapping[str, Any]]) -> None:
        """Gives an order as in ``[[mission.step]]``: ``{"waypoints-m": [[1.5, 1.9]]}``."""
        self._control.ask("mission", action=action)

    def press(self, column: int, row: int) -> None:
        """Taps the robot's display."""
        self._control.ask("press", display=[column, row])

    def pause(self) -> None:
        """Pauses virtual time."""
        self._control.ask("pause")

    def resume(self) -> None:
        """Resumes virtual time."""
        self._control.ask("resume")

    def step(self, by: str) -> None:
        """Advances virtual time by ``by`` and waits for it; call ``pause`` before."""
        self._control.ask("step", by=by)

    def verdict(self) -> Result:
        """The verdict so far; the run continues."""
        if self._result is not None:
            return self._result
        answer = self._control.ask("verdict")
        checks = [Check.of(check) for check in answer["checks"]]
        return Result(str(answer["verdict"]), checks, None, answer)

    def finish(self) -> Result:
        """Ends the run, writes the result folder, and returns the verdict."""
        if self._result is None:
            self._result = self._finish()
        return self._result

    def _finish(self) -> Result:
        try:
            self._control.ask("quit")
        except (OSError, ValueError):
            pass  # The run has already ended; its result is read below.
        self._control.close()
        try:
            said, _ = self._process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired as error:
            self._kill()
            raise RigError(f"hilrig does not end:\n{self.log()}") from error
        return _result(said, self.log())

    def keep_log(self) -> None:
        """Copies the output of the rig to the result folder."""
        self.finish()
        shutil.copyfile(self._work / "hilrig.log", self.out / "hilrig.log")

    def close(self) -> None:
        """Ends a running run, and removes its directory; a folder given as ``out`` stays."""
        try:
            if self._process.poll() is None and self._result is None:
                self.finish()
        finally:
            self._control.close()
            self._kill()
            self._clean()

    def _kill(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        for end in (self._process.stdin, self._process.stdout):
            if end is not None:
                end.close()

    def _clean(self) -> None:
        self._log.close()
        shutil.rmtree(self._work, ignore_errors=True)

    def __enter__(self) -> "Rig":
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()


def run(
    scenario: PathLike,
    program: str,
    *,
    out: PathLike,
    seed: Optional[int] = None,
    virtual: bool = False,
    may_end: bool = False,
    options: Sequence[str] = (),
    cwd: Optional[PathLike] = None,
    binary: Optional[str] = None,
) -> Result:
    """Starts the shell command ``program`` on the rig's ports and judges it, like ``hilrig run
    --exec``. Its environment contains ``HILRIG_DIR`` and ``HILRIG_PORT_<NAME>``; its working
    directory is ``cwd``."""
    command = binary or find_binary()
    # The ports need a short path, because the name of a socket is limited.
    work, ports = _ports()
    paths = [os.path.abspath(path) for path in (scenario, out)]
    words = [command, "run", paths[0], "--exec", program, "--out", paths[1]]
    words += ["--dir", str(ports), "--until-eof", "--json", *options]
    words += [] if seed is None else ["--seed", str(seed)]
    words += ["--exec-may-end"] if may_end else []
    words += _virtual(command, "run") if virtual else []
    # The input stays open, without data, while this process is running.
    with subprocess.Popen(
        words,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        start_new_session=True,
    ) as process:
        try:
            said, told = _read_both(process)
        except BaseException:
            process.kill()
            raise
        finally:
            shutil.rmtree(work, ignore_errors=True)
    return _result(said, told)


def _ports() -> Tuple[Path, Path]:
    work = Path(tempfile.mkdtemp(prefix="hilrig-"))
    return work, work / "ports"


def _read_both(process: "subprocess.Popen[str]") -> Tuple[str, str]:
    """Reads both outputs to their ends. ``communicate`` would close the input first."""
    told: List[str] = []
    errors = process.stderr
    assert errors is not None and process.stdout is not None
    reader = threading.Thread(target=lambda: told.append(errors.read()))
    reader.start()
    said = process.stdout.read()
    process.wait()
    reader.join()
    return said, "".join(told)


def _virtual(binary: str, verb: str) -> List[str]:
    if not knows(binary, verb, "--virtual"):
        raise RigError(
            f"{binary} ({version(binary)}) has no --virtual for `hilrig {verb}`: "
            "leave virtual time out, or install a version that has it"
        )
    return ["--virtual"]


def _result(said: str, told: str) -> Result:
    try:
        raw: Dict[str, Any] = json.loads(said)
    except ValueError as error:
        raise RigError(f"hilrig ended without a result:\n{told}") from error
    if raw["error"] is not None:
        raise RigError(str(raw["error"]))
    result = raw["result"]
    judged = result["judged"] if raw["command"] == "up" else result["runs"][0]
    checks = [Check.of(check) for check in judged["checks"]]
    folder = judged["folder"]
    verdict = "not-judged" if raw["verdict"] == "not-judged" else str(judged["verdict"])
    return Result(verdict, checks, None if folder is None else Path(folder), raw)
