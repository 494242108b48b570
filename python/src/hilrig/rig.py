"""Rigs for a scenario: with open ports, or with a program that is judged."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path
from typing import List, Mapping, Optional, Sequence, Tuple

from .binary import find_binary
from .result import Result
from .session import PathLike, Session, needed, result_of


class Rig(Session):
    """``hilrig up`` with a scenario: its devices are open ports, for this process to use."""

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
        super().__init__(out, binary)

        def words() -> List[str]:
            words = [self._binary, "up", os.fspath(scenario), "--dir", str(self.dir)]
            # The result folder contains the case; a copy in the working directory is not needed.
            words += ["--out", str(self.out), "--case", str(self._work / "up.toml")]
            words += ["--until-eof", "--json", *options]
            words += [] if seed is None else ["--seed", str(seed)]
            return words + (needed(self._binary, "up", "--virtual") if virtual else [])

        self._start(words)


class Running(Session):
    """``hilrig run --exec``: a program runs on the rig's ports while the test waits for conditions
    and adds faults. Its environment and working directory are those of ``run``.

    With ``virtual``, time passes only in ``wait``, ``step`` and ``finish``. A fault that the test
    adds after a condition therefore begins at the same nanosecond in every run.
    """

    def __init__(
        self,
        scenario: PathLike,
        program: str,
        *,
        out: Optional[PathLike] = None,
        seed: Optional[int] = None,
        virtual: bool = False,
        may_end: bool = False,
        options: Sequence[str] = (),
        cwd: Optional[PathLike] = None,
        binary: Optional[str] = None,
    ) -> None:
        super().__init__(out, binary)

        def words() -> List[str]:
            words = _run_words(self._binary, (scenario, program, self.out, self.dir), options)
            words += _chosen(self._binary, seed, virtual, may_end)
            return words + (needed(self._binary, "run", "--control") if virtual else [])

        self._start(words, cwd)

    def _finish(self) -> Result:
        """Waits until the scenario or the program ends, writes the result folder, and judges."""
        # Without a client, virtual time passes until the end.
        self._control.close()
        assert self._process.stdout is not None
        said = self._process.stdout.read()
        self._process.wait()
        return result_of(said, self.log())

    def _hang_up(self) -> None:
        # The command watches this pipe.
        assert self._process.stdin is not None
        self._process.stdin.close()

    def quit(self) -> Result:
        """Ends the run now, writes the result folder, and judges it."""
        return self._end(self._quit)


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
    words = _run_words(command, (scenario, program, out, ports), options)
    words += _chosen(command, seed, virtual, may_end)
    try:
        return _judged(words, cwd)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def firmware(
    scenario: PathLike,
    elf: PathLike,
    board: str,
    *,
    out: PathLike,
    wires: Optional[Mapping[str, str]] = None,
    seed: Optional[int] = None,
    options: Sequence[str] = (),
    cwd: Optional[PathLike] = None,
    binary: Optional[str] = None,
) -> Result:
    """Runs the firmware ``elf`` on a simulated board in virtual time and judges it, like ``hilrig
    run --firmware``. ``wires`` connects ports of the rig to ports of the board, for example
    ``{"air": "serial1"}``. ``elf`` is relative to ``cwd``."""
    words = [binary or find_binary(), "run", os.path.abspath(scenario)]
    words += ["--firmware", os.fspath(elf), "--board", board]
    words += [f"--wire={port}={to}" for port, to in (wires or {}).items()]
    words += ["--out", os.path.abspath(out), "--until-eof", "--json", *options]
    words += [] if seed is None else ["--seed", str(seed)]
    return _judged(words, cwd)


def _judged(words: Sequence[str], cwd: Optional[PathLike]) -> Result:
    """Runs ``hilrig run`` to its end."""
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
    return result_of(said, told)


def _run_words(
    binary: str, places: Tuple[PathLike, str, PathLike, PathLike], options: Sequence[str]
) -> List[str]:
    """The command for a scenario, a program, the folder of results and that of the ports."""
    scenario, program, out, ports = places
    words = [binary, "run", os.path.abspath(scenario), "--exec", program]
    words += ["--out", os.path.abspath(out), "--dir", os.fspath(ports)]
    return words + ["--until-eof", "--json", *options]


def _chosen(binary: str, seed: Optional[int], virtual: bool, may_end: bool) -> List[str]:
    words = [] if seed is None else ["--seed", str(seed)]
    words += ["--exec-may-end"] if may_end else []
    return words + (needed(binary, "run", "--virtual") if virtual else [])


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
