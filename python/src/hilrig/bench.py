"""A rig with one device."""

from __future__ import annotations

import json
import os
import re
import tempfile
from pathlib import Path
from typing import Any, Dict, Mapping, Optional, Tuple, Union

from .rig import Rig
from .session import Fault, PathLike

#: Rig time after which a device ends by itself: a day.
DURATION = "86400s"
#: Name of the device if its file or program suggests none.
NAME = "device"


class Bench(Rig):
    """One device on one port: a description, by its file or by the name of a shipped one, or a
    program that plays it (``exec="python3 scale.py"``, with ``rate`` and the other keys of
    ``[device.NAME.program]``).

    ::

        meter = Bench("modbus-meter")
        driver = minimalmodbus.Instrument(meter.path, 1)
        with meter.faulty("wrong-current"):
            ...
    """

    def __init__(
        self,
        device: PathLike = "",
        *,
        name: Optional[str] = None,
        exec: Optional[str] = None,
        settings: Optional[Mapping[str, Any]] = None,
        rate: Optional[int] = None,
        folder: Optional[PathLike] = None,
        **rig: Any,
    ) -> None:
        """Starts the rig; ``settings`` are keys of the device in a scenario, ``rig`` those of
        ``Rig``. The program ``exec`` runs in ``folder``, by default in the current one."""
        keys: Dict[str, Any] = {}
        if exec is not None:
            keys = {"exec": exec, "folder": os.path.abspath(folder or os.curdir)}
            keys.update({} if rate is None else {"rate": rate})
            keys.update({"description": _description(device)} if device else {})
            keys.update({} if settings is None else {"settings": dict(settings)})
        else:
            if not device:
                raise ValueError('which device? Bench("modbus-meter"), or Bench(exec="..")')
            file = _description(device)
            keys = {"description": {"file": file, **settings} if settings else file}
        stem = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(device).stem).strip("-") if device else ""
        #: Name of the device in the rig.
        self.name = name or stem or NAME
        kind = "program = " if exec is not None else ""
        table = _inline(keys)
        value = f"{{ {kind}{table} }}" if kind else table
        with tempfile.TemporaryDirectory(prefix="hilrig-") as folder:
            scenario = Path(folder) / "bench.toml"
            scenario.write_text(
                f'schema = 1\nname = "{self.name}"\nrobot = "none"\nduration = "{DURATION}"\n'
                f"device.{self.name} = {value}\n",
                encoding="utf-8",
            )
            super().__init__(scenario, **rig)

    @property
    def path(self) -> str:
        """The path of the device's port, of its first port if it has several."""
        return self.ports[self.name] if self.name in self.ports else next(iter(self.ports.values()))

    def faulty(self, fault: str, **keys: Any) -> Fault:
        """Begins a fault of the device; ``end`` or the end of a ``with`` block ends it."""
        return self.fault(device=self.name, kind="device", fault=fault, **keys)

    def value(self, name: str) -> Union[float, str, bool]:
        """A register or another value of the device, by its name."""
        rows = [row for panel in self.state()["panels"] for row in panel["rows"]]
        values = dict(_value(row) for row in rows)
        if name not in values:
            raise KeyError(f"{self.name} has no value {name!r}, expected one of {', '.join(values)}")
        return values[name]

    def wait_for(self, name: str, value: Any, timeout: str = "10s", op: str = "==") -> bool:
        """Waits until a value of the device meets ``op value``; ``timeout`` is rig time."""
        register = {"device": self.name, "name": name, "op": op, "value": value}
        return self.wait({"register": register}, timeout)


def _value(row: Mapping[str, Any]) -> Tuple[str, Union[float, str, bool]]:
    """Name and value of a row: ``voltage (230.2641 V)`` contains the value that is not rounded."""
    name, _, exact = str(row["name"]).partition(" (")
    text = exact.rstrip(")") if exact else str(row["value"])
    if text in ("true", "false"):
        return name, text == "true"
    try:
        return name, float(text.split(" ")[0])
    except ValueError:
        return name, text


def _description(device: PathLike) -> str:
    text = os.fspath(device)
    return os.path.abspath(text) if text.endswith(".toml") else text


def _inline(value: Any) -> str:
    """A value as TOML on one line."""
    if isinstance(value, Mapping):
        rows = [f"{json.dumps(str(key))} = {_inline(one)}" for key, one in value.items()]
        return "{ " + ", ".join(rows) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_inline(one) for one in value) + "]"
    # Texts, numbers and booleans of JSON are those of TOML.
    return json.dumps(value, ensure_ascii=False)
