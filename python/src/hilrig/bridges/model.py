"""The robot of a scenario, as a bridge needs it: its lidar, its wheels, their registers."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

#: Defaults of ``[world.body]``.
AXLE_M = 0.26
WHEEL_RADIUS_M = 0.026
TICKS_PER_TURN = 360
#: Bytes of a register, and whether it is signed.
WIDTHS = {
    "u8": (1, False),
    "i8": (1, True),
    "u16": (2, False),
    "i16": (2, True),
    "u32": (4, False),
    "i32": (4, True),
}
WHEELS = ("left", "right")


class ModelError(ValueError):
    """The scenario has no robot that a bridge can drive; names file and key."""


@dataclass(frozen=True)
class Register:
    """A register of the slave that drives the wheels."""

    address: int
    size: int
    is_signed: bool
    #: Speed of a count, metres per second; 0 for an encoder.
    speed_m_s: float = 0.0
    limits: Optional[Tuple[float, float]] = None

    def counts(self, speed_m_s: float) -> bytes:
        """The value for a wheel's speed, within the limits of the register and of its width."""
        low, high = self.limits if self.limits is not None else (-math.inf, math.inf)
        bits = 8 * self.size
        widest = (-(1 << bits - 1), (1 << bits - 1) - 1) if self.is_signed else (0, (1 << bits) - 1)
        count = round(speed_m_s / self.speed_m_s)
        count = int(max(low, widest[0], min(high, widest[1], count)))
        return count.to_bytes(self.size, "little", signed=self.is_signed)

    def value(self, data: bytes) -> int:
        return int.from_bytes(data, "little", signed=self.is_signed)


@dataclass(frozen=True)
class Lidar:
    """An XV-11 and its mount: x ahead, y to the left, heading counter-clockwise."""

    name: str
    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    #: Angle of the first reading to the axis of the housing.
    index0_rad: float = 0.0
    is_clockwise: bool = False


@dataclass(frozen=True)
class Base:
    """A slave of registers whose values drive two wheels."""

    name: str
    set_points: Dict[str, Register]
    encoders: Dict[str, Register] = field(default_factory=dict)


@dataclass(frozen=True)
class Model:
    """The robot."""

    lidar: Optional[Lidar]
    base: Optional[Base]
    axle_m: float
    #: Travel of a wheel per encoder tick.
    tick_m: float

    @classmethod
    def read(cls, path: "str | Path") -> "Model":
        """The robot of the scenario ``path``."""
        if sys.version_info < (3, 11):
            raise ModelError("a bridge needs Python 3.11 or later, which reads TOML")
        import tomllib

        try:
            scenario = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, tomllib.TOMLDecodeError) as error:
            raise ModelError(f"{path}: {error}, expected a scenario file") from error
        return cls.of(scenario, str(path))

    @classmethod
    def of(cls, scenario: Dict[str, Any], path: str) -> "Model":
        """The robot of a scenario's content."""
        devices = scenario.get("device", {})
        lidars = [_lidar(name, one["xv11"]) for name, one in devices.items() if "xv11" in one]
        bases = [_base(name, one["registers"]) for name, one in devices.items() if "registers" in one]
        found = [base for base in bases if base is not None]
        if not lidars and not found:
            raise ModelError(
                f"{path}: device: has no xv11 and no registers that drive the wheels left and "
                "right, expected one of them at least (docs/own-robot.md)"
            )
        body = scenario.get("world", {}).get("body", {})
        turn_m = 2 * math.pi * body.get("wheel_radius_m", WHEEL_RADIUS_M)
        return cls(
            lidars[0] if lidars else None,
            found[0] if found else None,
            body.get("axle_m", AXLE_M),
            turn_m / body.get("ticks_per_turn", TICKS_PER_TURN),
        )


def _lidar(name: str, table: Dict[str, Any]) -> Lidar:
    mount = table.get("mount", {})
    return Lidar(
        name,
        mount.get("x_m", 0.0),
        mount.get("y_m", 0.0),
        math.radians(mount.get("heading_deg", 0.0)),
        math.radians(table.get("index0_deg", 0.0)),
        table.get("direction") == "clockwise",
    )


def _base(name: str, table: Dict[str, Any]) -> Optional[Base]:
    rows: List[Dict[str, Any]] = table.get("register", [])
    set_points: Dict[str, Register] = {}
    encoders: Dict[str, Register] = {}
    for row in rows:
        size, is_signed = WIDTHS.get(row.get("width", "u8"), (1, False))
        drives, source = row.get("drives", {}), row.get("source", {})
        wheel = drives.get("actuator")
        if wheel in WHEELS and "speed_m_s" in drives:
            limits = tuple(row["limits"]) if "limits" in row else None
            set_points[wheel] = Register(
                row["address"], size, is_signed, drives["speed_m_s"], limits
            )
        encoder = source.get("encoder") if isinstance(source, dict) else None
        if encoder in WHEELS:
            encoders[encoder] = Register(row["address"], size, is_signed)
    if set(set_points) != set(WHEELS):
        return None
    return Base(name, set_points, encoders if set(encoders) == set(WHEELS) else {})
