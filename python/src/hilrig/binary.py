"""The location of the command ``hilrig``."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sysconfig
from pathlib import Path


class BinaryNotFound(RuntimeError):
    """The command ``hilrig`` was not found."""


def find_binary() -> str:
    """The command in ``$HILRIG``, else the one of this package, else the one in ``PATH``."""
    named = os.environ.get("HILRIG")
    if named:
        return named
    schemes = [sysconfig.get_path("scripts"), sysconfig.get_path("scripts", scheme=_user_scheme())]
    for folder in schemes:
        path = Path(folder) / "hilrig"
        if path.is_file():
            return str(path)
    found = shutil.which("hilrig")
    if found:
        return found
    raise BinaryNotFound(
        "no command hilrig: expected it in $HILRIG, beside Python or in PATH "
        "(cargo install --path .)"
    )


def _user_scheme() -> str:
    return sysconfig.get_preferred_scheme("user") if hasattr(
        sysconfig, "get_preferred_scheme"
    ) else "posix_user"


@functools.lru_cache(maxsize=None)
def knows(binary: str, verb: str, option: str) -> bool:
    """Whether ``verb`` has ``option``; an older command may not have it."""
    shown = subprocess.run(
        [binary, verb, "--help"], capture_output=True, text=True, check=False
    )
    return option in shown.stdout.replace(",", " ").replace("=", " ").split()


@functools.lru_cache(maxsize=None)
def version(binary: str) -> str:
    """The output of ``--version``."""
    shown = subprocess.run([binary, "--version"], capture_output=True, text=True, check=False)
    return shown.stdout.strip() or "of an unknown version"
