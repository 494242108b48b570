"""A running rig: its process, and its control by ports, faults, conditions and orders."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Type, TypeVar, Union

from .binary import find_binary, knows, version
from .control import ENDED, Control, has_ended
from .result import Check, Result

#: A path.
PathLike = Union[str, "os.PathLike[str]"]
#: Timeout for the start and the end of a rig, wall time in seconds.
PATIENCE = 30.0


class RigError(RuntimeError):
    """The rig did not start, or did not end correctly; contains the reason."""


class Fault:
    """An active fault; ``end`` or the end of a ``with`` block ends it."""

    def __init__(self, rig: "Session", number: int) -> None:
        self._rig = rig
        #: Number of the fault, as in ``hilrig fault list``.
        self.number = number
        self._is_over = False

    def end(self) -> None:
        """Ends the fault now."""
        if not self._is_over:
            self._is_over = True
            self._rig.ask("end", id=self.number)

    def __enter__(self) -> "Fault":
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.end()
        except (OSError, ValueError) as error:
            # The end of the rig ends its faults, too.
            if not has_ended(error):
                raise


_Self = TypeVar("_Self", bound="Session")


class Session:
    """A running rig with a control socket, in its own directory: a ``Rig`` or a ``Running``.

    The rig ends together with this process, even after a kill: it watches a pipe to this process.
    """

    def __init__(self, out: Optional[PathLike], binary: Optional[str]) -> None:
        self._binary = binary or find_binary()
        # A short path: the name of a Unix socket has at most 107 bytes.
        self._work = Path(tempfile.mkdtemp(prefix="hilrig-"))
        #: Directory of the ports.
        self.dir = self._work / "ports"
        #: Result folder; written when the rig ends.
        self.out = Path(os.path.abspath(out)) if out is not None else self._work / "out"
        self._result: Optional[Result] = None
        #: The error of the end of the run, in place of a result.
        self._error: Optional[RigError] = None
        self._is_kept = out is not None
        #: The output of a closed rig.
        self._told: Optional[str] = None
        self._log = (self._work / "hilrig.log").open("w+", encoding="utf-8")

    def _start(
        self, words: Callable[[], Sequence[str]], cwd: Optional[PathLike] = None
    ) -> None:
        """Starts the command that ``words`` gives, and connects to its control socket."""
        try:
            #: The command that was started.
            self.command = list(words())
            self._process = self._spawn(cwd)
        except BaseException:
            self._clean()
            raise
        try:
            self._control = self._connect()
            greeting = self._control.greeting
            #: Paths of the ports by name.
            self.ports: Dict[str, str] = {
                str(port["name"]): str(port["path"]) for port in greeting["ports"]
            }
            #: Seed of all randomness.
            self.seed: int = int(greeting["seed"])
        except BaseException:
            self._kill()
            self._clean()
            raise

    def _spawn(self, cwd: Optional[PathLike]) -> "subprocess.Popen[str]":
        try:
            # In its own session: after a signal to pytest's process group the rig must still
            # remove its ports.
            return subprocess.Popen(
                self.command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log,
                text=True,
                cwd=cwd,
                start_new_session=True,
            )
        except OSError as error:
            raise RigError(f"{self._binary} cannot be started: {error}") from error

    def _connect(self) -> Control:
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                return Control(self.dir)
            except OSError as error:
                if self._process.poll() is not None:
                    raise RigError(self._why_ended()) from error
                if time.monotonic() > deadline:
                    raise RigError(f"hilrig does not answer:\n{self.log()}") from error
            time.sleep(0.01)

    def _why_ended(self) -> str:
        """The error of a command that has ended before it answered."""
        said = self._process.stdout.read() if self._process.stdout is not None else ""
        try:
            error = json.loads(said)["error"]
        except (ValueError, KeyError, TypeError):
            error = None
        return str(error) if error else f"hilrig ended at once:\n{self.log()}"

    def port(self, name: str) -> str:
        """The path of a port, to be opened like any serial port."""
        if name not in self.ports:
            known = ", ".join(self.ports)
            raise KeyError(f"there is no port {name!r}, expected one of {known}")
        return self.ports[name]

    def log(self) -> str:
        """The output of the rig so far."""
        if self._told is not None:
            return self._told
        self._log.flush()
        return (self._work / "hilrig.log").read_text(encoding="utf-8", errors="replace")

    def ask(self, do: str, **keys: Any) -> Dict[str, Any]:
        """Sends one request of docs/control.md and returns its answer."""
        try:
            return self._control.ask(do, **keys)
        except (OSError, ValueError) as error:
            explained = self._explained(error)
            if explained is error:
                raise
            raise explained from error

    def _explained(self, error: Exception) -> Exception:
        """The error of a request; after the end of the rig with its result."""
        if not has_ended(error) or self._is_running():
            return error
        try:
            how = str(self._end(self._quit))
        except RigError as reason:
            how = str(reason)
        return ConnectionError(f"{ENDED}\n{how}")

    def _is_running(self) -> bool:
        """Whether the rig still answers; it may disconnect a client."""
        try:
            Control(self.dir).close()
        except OSError:
            return False
        except ValueError:
            return True  # It refuses another client.
        return True

    def fault(self, link: Optional[str] = None, **keys: Any) -> Fault:
        """Adds a fault as in a scenario: ``fault("base", direction="to-device", kind="cut")``.

        Append ``_`` to a key that is a Python keyword: ``from_``.
        """
        fault = {key.rstrip("_"): value for key, value in keys.items()}
        if link is not None:
            fault["link"] = link
        return Fault(self, int(self.ask("add", fault=fault)["id"]))

    def wait(self, condition: Mapping[str, Any], timeout: str = "10s") -> bool:
        """Waits until ``condition`` holds (docs/control.md); ``timeout`` is rig time."""
        answer = self.ask("wait", **{"for": dict(condition)}, timeout=timeout)
        return bool(answer["held"])

    def state(self) -> Dict[str, Any]:
        """The current state of the robot."""
        return self.ask("state")

    def mission(self, action: Union[str, Mapping[str, Any]]) -> None:
        """Gives an order as in ``[[mission.step]]``: ``{"waypoints-m": [[1.5, 1.9]]}``."""
        self.ask("mission", action=action)

    def press(self, column: int, row: int) -> None:
        """Taps the robot's display."""
        self.ask("press", display=[column, row])

    def pause(self) -> None:
        """Pauses rig time."""
        self.ask("pause")

    def resume(self) -> None:
        """Resumes rig time."""
        self.ask("resume")

    def step(self, by: str) -> None:
        """Advances rig time by ``by`` and waits for it; in real time call ``pause`` before."""
        self.ask("step", by=by)

    def verdict(self) -> Result:
        """The verdict so far; the run continues."""
        if self._result is not None:
            return self._result
        answer = self.ask("verdict")
        checks = [Check.of(check) for check in answer["checks"]]
        return Result(str(answer["verdict"]), checks, None, answer)

    def finish(self) -> Result:
        """Ends the run, writes the result folder, and returns the verdict."""
        return self._end(self._finish)

    def _end(self, end: Callable[[], Result]) -> Result:
        """Ends the run by ``end`` once; then its result or its error is known."""
        if self._error is not None:
            raise self._error
        if self._result is None:
            try:
                self._result = end()
            except RigError as error:
                self._error = error
                raise
        return self._result

    def _finish(self) -> Result:
        return self._quit()

    def _hang_up(self) -> None:
        """Ends a ``finish`` in another thread."""

    def _quit(self) -> Result:
        """Ends the run now."""
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
        return result_of(said, self.log())

    def keep_log(self) -> None:
        """Ends a running run, and writes the output of the rig to the folder given as ``out``."""
        try:
            if self._told is None and self._result is None and self._error is None:
                self._end(self._quit)
        finally:
            if self._is_kept:
                self.out.mkdir(parents=True, exist_ok=True)
                (self.out / "hilrig.log").write_text(self.log(), encoding="utf-8")

    def close(self) -> None:
        """Ends a running run, and removes its directory; a folder given as ``out`` stays."""
        if self._told is not None:
            return
        is_over = self._process.poll() is not None
        try:
            if self._result is None and self._error is None:
                self._end(self._quit)
        except RigError:
            # A run that ended by itself tells its error to the request that needs it.
            if not is_over:
                raise
        finally:
            self._control.close()
            self._kill()
            self._told = self.log()
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

    def __enter__(self: _Self) -> _Self:
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()


def needed(binary: str, verb: str, option: str) -> List[str]:
    """The option, if the command has it; an older one may not."""
    if not knows(binary, verb, option):
        raise RigError(
            f"{binary} ({version(binary)}) has no {option} for `hilrig {verb}`: "
            "install a version that has it, or use real time"
        )
    return [option]


def result_of(said: str, told: str) -> Result:
    """The result in the output ``said`` of a command; ``told`` is its standard error."""
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
