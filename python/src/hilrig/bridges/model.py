"""The robot of a scenario, as a bridge needs it: its lidar, its wheels, their registers."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, List, NoReturn, Optional, Tuple

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
#: Sources of a register that counts a wheel, besides ``{ encoder = ".." }``.
ENCODERS = {"encoder-left": "left", "encoder-right": "right"}
#: Firmware of an XV-11 that sends whole turns in a format of its own.
OLD_FIRMWARE = "fw2.1"


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

    def count(self, speed_m_s: float) -> int:
        """The value for a wheel's speed, within the limits of the register and of its width."""
        low, high = self.limits if self.limits is not None else (-math.inf, math.inf)
        bits = 8 * self.size
        widest = (-(1 << bits - 1), (1 << bits - 1) - 1) if self.is_signed else (0, (1 << bits) - 1)
        return round(max(low, widest[0], min(high, widest[1], speed_m_s / self.speed_m_s)))

    def reached(self, speed_m_s: float) -> float:
        """The speed of a wheel that obeys the value for ``speed_m_s``."""
        return self.count(speed_m_s) * self.speed_m_s

    def counts(self, speed_m_s: float) -> bytes:
        """The bytes of ``count``."""
        return self.count(speed_m_s).to_bytes(self.size, "little", signed=self.is_signed)

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
    #: Whether the checksum of a frame has its high byte first.
    is_high_first: bool = False


@dataclass(frozen=True)
class Model:
    """The robot."""

    lidar: Optional[Lidar]
    base: Optional[Base]
    axle_m: float
    #: Travel of a wheel per encoder tick.
    tick_m: float
    #: Lines about what the bridge does not do for this robot.
    notes: Tuple[str, ...] = ()

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
        try:
            return _model(scenario, path)
        except (AttributeError, KeyError, TypeError) as error:
            raise ModelError(f"{path}: {error!r}, expected a scenario that hilrig runs") from error


def _model(scenario: Dict[str, Any], path: str) -> Model:
    if "ackermann" in scenario.get("chassis", {}):
        _refuse(path, "chassis.ackermann", "is a car", "[chassis.differential], two driven wheels")
    devices = scenario.get("device", {})
    lidars = {name: one["xv11"] for name, one in devices.items() if "xv11" in one}
    slaves = {name: one["registers"] for name, one in devices.items() if "registers" in one}
    bases = [base for base in map(_base, slaves, slaves.values()) if base is not None]
    if not lidars and not bases:
        raise ModelError(
            f"{path}: device: has no xv11 and no registers that drive the wheels left and "
            "right, expected one of them at least (docs/own-robot.md)"
        )
    lidar = next((_lidar(name, table, path) for name, table in lidars.items()), None)
    base = bases[0] if bases else None
    body = scenario.get("world", {}).get("body", {})
    turn_m = 2 * math.pi * body.get("wheel_radius_m", WHEEL_RADIUS_M)
    return Model(
        lidar,
        base,
        body.get("axle_m", AXLE_M),
        turn_m / body.get("ticks_per_turn", TICKS_PER_TURN),
        tuple(f"{path}: {note}" for note in _notes(lidars, slaves, bases)),
    )


def _refuse(path: str, key: str, found: str, expected: str) -> NoReturn:
    message = f"{key}: {found}, which a bridge does not support, expected {expected}"
    raise ModelError(f"{path}: {message}")


def _notes(lidars: Dict[str, Any], slaves: Dict[str, Any], bases: List[Base]) -> List[str]:
    notes = [
        f"device.{name}: is not used, a bridge uses the first one of its kind"
        for name in [*list(lidars)[1:], *(base.name for base in bases[1:])]
    ]
    if not lidars:
        notes.append("device: has no xv11, so there is no /scan")
    if not bases:
        names = ", ".join(f"device.{name}" for name in slaves) or "device"
        notes.append(
            f"{names}: has no registers with drives = {{ actuator = \"left\", speed_m_s = .. }} "
            "for left and right, so there is no /odom, and /cmd_vel has no effect"
        )
    elif not bases[0].encoders:
        notes.append(
            f"device.{bases[0].name}: has no registers with source = {{ encoder = \"left\" }} for "
            "left and right, so /odom assumes that the wheels follow their commands"
        )
    return notes


def _lidar(name: str, table: Dict[str, Any], path: str) -> Lidar:
    key = f"device.{name}.xv11"
    if table.get("profile") == OLD_FIRMWARE:
        others = '"fw2.4.13386" or "fw2.6.15295", which send packets'
        _refuse(path, f"{key}.profile", f'is "{OLD_FIRMWARE}"', others)
    if "host-v" in table.get("supply", {}):
        _refuse(path, f"{key}.supply", "is the host's drive", "regulated-rpm or fixed-v")
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
        size, is_signed = WIDTHS[row["width"]]
        drives, source = row.get("drives", {}), row.get("source", {})
        wheel = drives.get("actuator")
        if wheel in WHEELS and "speed_m_s" in drives:
            limits = tuple(row["limits"]) if "limits" in row else None
            set_points[wheel] = Register(
                row["address"], size, is_signed, drives["speed_m_s"], limits
            )
        is_table = isinstance(source, dict)
        encoder = source.get("encoder") if is_table else ENCODERS.get(source)
        if encoder in WHEELS:
            encoders[encoder] = Register(row["address"], size, is_signed)
    if set(set_points) != set(WHEELS):
        return None
    is_counted = set(encoders) == set(WHEELS)
    is_high_first = table.get("checksum") == "high-first"
    return Base(name, set_points, encoders if is_counted else {}, is_high_first)
