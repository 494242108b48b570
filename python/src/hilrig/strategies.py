"""Hypothesis strategies for the description of a device.

::

    METER = hilrig.strategies("meter.toml")

    @given(write=METER.writes())
    def test_what_is_written_is_read(write):
        ...

Requires the package ``hypothesis``, and Python 3.11 for its TOML parser.
"""

from __future__ import annotations

import math
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple, Union

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

#: Range of counts by type name.
COUNTS: Dict[str, Tuple[int, int]] = {
    f"{sign}{bits}": (
        (0, 2**bits - 1) if sign == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    )
    for sign in "ui"
    for bits in (8, 16, 24, 32, 64)
}
#: Widths of floats, bits.
FLOATS = {"f32": 32, "f64": 64}
#: The greatest 32-bit float.
F32_MAX = (2 - 2**-23) * 2.0**127
#: Faults that every described device has.
FAULTS = ("off", "restart", "stuck", "garbage", "wrong", "slow")
#: Tolerance for a limit that is a count apart from rounding, in counts.
SLACK = 1e-6
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
    #: Value of one count, and value of count 0.
    scale: Optional[float]
    offset: float
    limits: Optional[Tuple[float, float]]
    #: Bytes of a text.
    size: int
    #: The file of the description.
    file: str = ""

    def values(self) -> "SearchStrategy[Any]":
        """Values within the type and limits of the register, in its unit."""
        import hypothesis.strategies as st

        if self.table in ("coils", "discrete"):
            return st.booleans()
        if self.kind == "str":
            return st.text("abcdefghijklmnopqrstuvwxyz 0123456789", max_size=self.size)
        kind = self.kind
        if kind[-2:] in ("le", "be"):
            # Remove the byte order.
            kind = kind[:-2]
        if kind in FLOATS:
            return self._floats(FLOATS[kind])
        if kind not in COUNTS:
            raise ValueError(
                f"{self.file}: the register {self.name} has the type {self.kind}, expected one of "
                + ", ".join([*COUNTS, *FLOATS, "str"])
                + ", with le or be behind it if need be"
            )
        low_count, high_count = COUNTS[kind]
        if self.limits is not None:
            step = self.scale or 1.0
            bounds = sorted((limit - self.offset) / step for limit in self.limits)
            # A bound that is a count apart from rounding is that count.
            low_count = max(low_count, math.ceil(bounds[0] - SLACK))
            high_count = min(high_count, math.floor(bounds[1] + SLACK))
        if low_count > high_count:
            raise self._without_values()
        counts = st.integers(low_count, high_count)
        if self.scale is None and self.offset == 0:
            return counts
        scale, offset = self.scale or 1.0, self.offset
        return counts.map(lambda count: count * scale + offset)

    def _floats(self, width: int) -> "SearchStrategy[float]":
        """Floats of this width whose values are within the limits."""
        import hypothesis.strategies as st

        scale, offset = self.scale or 1.0, self.offset
        low, high = -math.inf, math.inf
        if self.limits is not None:
            low, high = sorted((limit - offset) / scale for limit in self.limits)
        if width == 32:
            low, high = _inward(low, high)
        if low > high:
            raise self._without_values()
        floats = st.floats(
            None if low == -math.inf else low,
            None if high == math.inf else high,
            width=32 if width == 32 else 64,
            allow_nan=False,
            allow_infinity=False,
        )
        if self.scale is None and offset == 0:
            return floats
        return floats.map(lambda raw: raw * scale + offset)

    def _without_values(self) -> ValueError:
        return ValueError(
            f"{self.file}: no value of the register {self.name} ({self.kind}) is within its limits "
            f"{self.limits}"
        )


def _inward(low: float, high: float) -> Tuple[float, float]:
    """The smallest and the greatest 32-bit float between the bounds."""

    def near(bound: float, step: int) -> float:
        if math.isinf(bound) or abs(bound) > F32_MAX:
            return math.copysign(math.inf, bound)
        single = float(struct.unpack("<f", struct.pack("<f", bound))[0])
        if (single - bound) * step >= 0:
            return single
        # The next float in the direction of the step.
        (bits,) = struct.unpack("<i", struct.pack("<f", single))
        if single == 0:
            bits = 1 if step > 0 else -0x7FFFFFFF
        else:
            bits += step if single > 0 else -step
        return float(struct.unpack("<f", struct.pack("<i", bits))[0])

    return near(low, 1), near(high, -1)


class Strategies:
    """Strategies for the registers and faults of one description."""

    def __init__(self, path: Union[str, "os.PathLike[str]"]) -> None:
        import tomllib

        text = Path(path).read_text(encoding="utf-8")
        try:
            described = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"{os.fspath(path)}: {error}") from error
        #: Registers by name.
        self.registers: Dict[str, Register] = {}
        for table, rows in described.get("registers", {}).items():
            for row in rows if isinstance(rows, list) else []:
                if isinstance(row, dict):
                    register = _register(os.fspath(path), table, row)
                    self.registers[register.name] = register
        #: Names of the faults: common faults of all devices, then those of the description.
        self.fault_names: List[str] = [*FAULTS, *described.get("faults", {})]
        self._path = os.fspath(path)

    def values(self, name: str) -> "SearchStrategy[Any]":
        """Values that the register ``name`` accepts, in its unit."""
        if name not in self.registers:
            known = ", ".join(self.registers) or "none"
            raise KeyError(f"{self._path} has no register {name!r}, expected one of {known}")
        return self.registers[name].values()

    def writes(self) -> "SearchStrategy[Tuple[Register, Any]]":
        """A register that the driver may write, and a value that the register accepts."""
        import hypothesis.strategies as st

        writable = [one for one in self.registers.values() if one.is_writable]
        if not writable:
            raise ValueError(f"{self._path} has no register that a driver may write")
        return st.one_of([st.tuples(st.just(one), one.values()) for one in writable])

    def faults(self) -> "SearchStrategy[str]":
        """Names of the device's faults: ``rig.fault(device="meter", kind="device", fault=..)``."""
        import hypothesis.strategies as st

        return st.sampled_from(self.fault_names)


def _register(file: str, table: str, row: Dict[str, Any]) -> Register:
    is_measured = "source" in row or "value" in row
    usual = "write" if table in WRITABLE and not is_measured else "read"
    limits = row.get("limits")
    for key in ("at", "name"):
        if key not in row:
            raise ValueError(f"{file}: a register of [[registers.{table}]] has no {key!r}")
    return Register(
        table=table,
        address=int(row["at"]),
        name=str(row["name"]),
        kind=str(row.get("type", "u16")),
        is_writable=row.get("access", usual) == "write",
        scale=row.get("scale"),
        offset=float(row.get("offset", 0)),
        limits=None if limits is None else (float(limits[0]), float(limits[1])),
        size=int(row.get("size", 1)),
        file=file,
    )


def strategies(path: Union[str, "os.PathLike[str]"]) -> Strategies:
    """Strategies for the description in the file ``path``."""
    return Strategies(path)
