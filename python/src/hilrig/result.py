"""The result of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional


#: Number of shown lines of a program's output.
LINES = 10


@dataclass(frozen=True)
class Check:
    """One check with its status."""

    name: str
    #: ``pass``, ``fail`` or ``not-observed``: the property was not observed.
    status: str
    #: A sentence with figures.
    detail: str

    def __str__(self) -> str:
        return f"{self.status} {self.name}: {self.detail}"

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> "Check":
        return cls(str(table["name"]), str(table["status"]), str(table["detail"]))


@dataclass(frozen=True)
class Result:
    """A judged run."""

    #: ``pass``, ``fail`` or ``not-judged``: the rig itself was too late.
    verdict: str
    checks: List[Check]
    #: Result folder: report.html, capture.pcapng and so on; none during the run.
    folder: Optional[Path]
    #: The complete output of the command, see ``hilrig schema --output``.
    raw: Dict[str, Any]

    @property
    def probable_cause(self) -> Optional[str]:
        """The reason why a program failed; ``None`` if it passed, or hilrig did not start it."""
        result = self.raw.get("result") or {}
        runs = result.get("runs") or [result.get("judged") or {}]
        cause = runs[0].get("probable_cause")
        return None if cause is None else str(cause)

    @property
    def passed(self) -> bool:
        return self.verdict == "pass"

    @property
    def failures(self) -> List[Check]:
        return [check for check in self.checks if check.status == "fail"]

    def assert_passed(self) -> None:
        """Raises an error with the failed checks and the path of the report."""
        if not self.passed:
            raise AssertionError(str(self))

    def __bool__(self) -> bool:
        return self.passed

    def __str__(self) -> str:
        lines = [f"the rig's verdict is {self.verdict}"]
        shown = self.failures
        if self.verdict != "pass" and not shown:
            # A rule that was not observed is not passed.
            shown = [one for one in self.checks if one.status == "not-observed" and one.name.startswith("rule-")]
        lines += [f"  {check}" for check in shown]
        if self.probable_cause is not None:
            lines.append(f"  probable cause: {self.probable_cause}")
        if self.folder is not None:
            lines.append(f"  report: {self.folder / 'report.html'}")
            words = self.folder / "program.log"
            if not self.passed and words.is_file():
                last = words.read_text(encoding="utf-8", errors="replace").splitlines()[-LINES:]
                lines += ["  the program's last words:"] + [f"  | {line}" for line in last]
        return "\n".join(lines)
