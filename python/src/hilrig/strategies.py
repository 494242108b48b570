"""Hypothesis strategies made from the description of a device.

::

    METER = hilrig.strategies("meter.toml")

    @given(write=METER.writes())
    def test_what_is_written_is_read(write):
        ...

Needs the package ``hypothesis``, and Python 3.11 for its reader of TOML.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple, Union

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

#: Counts that a type can have, by its name.
COUNTS: Dict[str, Tuple[int, int]] = {
    f"{sign}{bits}": (
        (0, 2**bits - 1) if sign == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    )
    for sign in "ui"
    for bits in (8, 16, 24, 32, 64)
}
#: Widths of floats, bits.
FLOATS = {"f32": 32, "f64": 64}
#: Tables that a driver may write.
WRITABLE = ("coils", "holding")


@dataclass(frozen=True)
class Register:
    """A register of the description."""

    table: str
    address: int
    name: str
    kind: str
    #: Whether the driver may write it.
    is_writable: bool
    #: Value of a count, and of count 0.
    scale: Optional[float]
    offset: float
    limits: Optional[Tuple[float, float]]
    #: Bytes of a text.
    size: int

    def values(self) -> "SearchStrategy[Any]":
        """Values within its type and limits, in its unit."""
        import hypothesis.strategies as st

        if self.table in ("coils", "discrete"):
            return st.booleans()
        if self.kind == "str":
            return st.text("abcdefghijklmnopqrstuvwxyz 0123456789", max_size=self.size)
        if self.kind in FLOATS:
            low, high = self.limits or (None, None)
            width = FLOATS[self.kind]
            low, high = (_float(bound, width, st) for bound in (low, high))
            return st.floats(low, high, width=width, allow_nan=False, allow_infinity=False)
        if self.kind not in COUNTS:
            raise ValueError(
                f"the register {self.name} has the type {self.kind}, expected one of "
                + ", ".join([*COUNTS, *FLOATS, "str"])
            )
        low_count, high_count = COUNTS[self.kind]
        if self.limits is not None:
            step = self.scale or 1.0
            bounds = sorted((limit - self.offset) / step for limit in self.limits)
            # A bound that is a count but for rounding is that count.
            low_count = max(low_count, -int(-(bounds[0] - 1e-9) // 1))
            high_count = min(high_count, int((bounds[1] + 1e-9) // 1))
        counts = st.integers(low_count, high_count)
        if self.scale is None and self.offset == 0:
            return counts
        scale, offset = self.scale or 1.0, self.offset
        return counts.map(lambda count: count * scale + offset)


def _float(bound: Optional[float], width: int, st: Any) -> Optional[float]:
    """The bound as a float of this width."""
    import struct

    if bound is None or width == 64:
        return bound
    return float(struct.unpack("f", struct.pack("f", bound))[0])


class Strategies:
    """Strategies for the registers and faults of one description."""

    def __init__(self, path: Union[str, "os.PathLike[str]"]) -> None:
        import tomllib

        text = Path(path).read_text(encoding="utf-8")
        try:
            described = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"{os.fspath(path)}: {error}") from error
        #: Registers by their names.
        self.registers: Dict[str, Register] = {}
        for table, rows in described.get("registers", {}).items():
            for row in rows if isinstance(rows, list) else []:
                if isinstance(row, dict):
                    register = _register(table, row)
                    self.registers[register.name] = register
        #: Names of the faults.
        self.fault_names: List[str] = list(described.get("faults", {}))
        self._path = os.fspath(path)

    def values(self, name: str) -> "SearchStrategy[Any]":
        """Values that the register ``name`` takes, in its unit."""
        if name not in self.registers:
            known = ", ".join(self.registers) or "none"
            raise KeyError(f"{self._path} has no register {name!r}, expected one of {known}")
        return self.registers[name].values()

    def writes(self) -> "SearchStrategy[Tuple[Register, Any]]":
        """A register that the driver may write, and a value that the register takes."""
        import hypothesis.strategies as st

        writable = [one for one in self.registers.values() if one.is_writable]
        if not writable:
            raise ValueError(f"{self._path} has no register that a driver may write")
        return st.one_of([st.tuples(st.just(one), one.values()) for one in writable])

    def faults(self) -> "SearchStrategy[str]":
        """Names of the device's faults: ``rig.fault(device="meter", kind="device", fault=..)``."""
        import hypothesis.strategies as st

        if not self.fault_names:
            raise ValueError(f"{self._path} has no [faults]")
        return st.sampled_from(self.fault_names)


def _register(table: str, row: Dict[str, Any]) -> Register:
    access = row.get("access", "write" if table in WRITABLE else "read")
    limits = row.get("limits")
    return Register(
        table=table,
        address=int(row["at"]),
        name=str(row["name"]),
        kind=str(row.get("type", "u16")),
        is_writable=access == "write" and "value" not in row,
        scale=row.get("scale"),
        offset=float(row.get("offset", 0)),
        limits=None if limits is None else (float(limits[0]), float(limits[1])),
        size=int(row.get("size", 1)),
    )


def strategies(path: Union[str, "os.PathLike[str]"]) -> Strategies:
    """Strategies made from the description in the file ``path``."""
    return Strategies(path)
