"""Devices in Python: a program that implements a device of a rig, or the robot's program.

::

    from hilrig.device import Device, main

    class Thermometer(Device):
        ends = b"\\r\\n"                      # hear() gets whole lines

        def hear(self, line, now):
            if line == b"T?":
                self.send(b"21.5\\r\\n", after=0.02)

    main(Thermometer)

A scenario names the program: ``[device.meter.program]`` with ``exec = "python3 thermometer.py"``.
The rig sends requests and the program answers. Only the rig controls time: ``now`` is virtual time
in seconds. Every run gives the same bytes if the program does not read the computer's clock, does
not sleep, and uses only the random numbers of ``self.random``. Printed text goes to its log.

The protocol is described in ``docs/nodes.md``.
"""

from __future__ import annotations

import json
import pickle
import random
import struct
import sys
from heapq import heappop, heappush
from typing import Any, BinaryIO, Callable, Dict, List, Optional, Tuple, Union

__all__ = ["Device", "Message", "main"]

VERSION = 1
NEVER = 0xFFFFFFFFFFFFFFFF
_HEAD = struct.Struct("<I")
_EXCHANGE = struct.Struct("<BQH")
_ITEM = struct.Struct("<BBHQ")
_VALUE = struct.Struct("<d")
_FAULT = struct.Struct("<Bd")
_CODING = struct.Struct("<BIBBB")
_EVENTS = ("opened", "closed", "break", "framing-error", "parity-error", "overrun")
_PARITIES = "NEO"


class Message:
    """A message of the device's description: its name, and its fields as attributes."""

    def __init__(self, name: str, **fields: Any) -> None:
        self.name = name
        self.fields = fields

    def __getattr__(self, field: str) -> Any:
        try:
            return self.__dict__["fields"][field]
        except KeyError:
            raise AttributeError(f"the message {self.__dict__.get('name')} has no field {field}")

    def __repr__(self) -> str:
        fields = ", ".join(f"{name}={value!r}" for name, value in self.fields.items())
        return f"{self.name}({fields})"


class Device:
    """A device. Override the methods for events; call the others.

    Each event calls one method. The return value of the method is sent: bytes, a message, or a list
    of them.
    """

    #: Line terminator; if set, ``hear`` gets whole lines without it.
    ends: Optional[bytes] = None
    #: Maximum length of a line; of a longer line only the last bytes are kept.
    line_max = 4096
    #: Names of the faults that ``fault`` handles.
    faults: Tuple[str, ...] = ()
    #: Names of the values that ``show`` sets.
    outputs: Tuple[str, ...] = ()
    #: Whether attributes hold the complete state: then runs can branch and are minimised faster.
    saves = False
    #: Whether the rig decodes and encodes frames of the description: ``on_NAME`` for each message.
    typed = False

    #: Values from the scenario and the rig, set before ``start``.
    name = ""
    seed = 0
    settings: Dict[str, Any] = {}
    ports: List[Dict[str, Any]] = []
    messages: List[Dict[str, Any]] = []
    quantities: Dict[str, float] = {}
    random: random.Random

    def __init_subclass__(cls, description: Optional[str] = None, **more: Any) -> None:
        super().__init_subclass__(**more)
        if description is not None:
            cls.typed = True
            cls._description = description

    _description: Optional[str] = None

    # Events.

    def start(self) -> None:
        """Called when the run begins; the time is 0."""

    def receive(self, data: bytes, now: float, port: int = 0) -> Any:
        """Called for received bytes; the last byte ended at ``now``."""
        if self.ends is None:
            return self.hear(data, now)
        heard = self._heard.get(port, b"") + data
        *lines, rest = heard.split(self.ends)
        self._heard[port] = rest[-self.line_max :]
        for line in lines:
            self._say(self.hear(line, now), port)
        return None

    def hear(self, line: bytes, now: float) -> Any:
        """Called for a received line of text, or for bytes if the device has no ``ends``."""

    def unknown(self, data: bytes, now: float) -> Any:
        """Called for received bytes that are not a message of the description."""
        self.violation("unknown-message", f"{len(data)} bytes are no message of the description", data)

    def line(self, event: str, now: float, port: int = 0) -> Any:
        """Called when the other end opens or closes its port, or sends a ``break``."""

    def fault(self, name: str, begins: bool, figure: Optional[float], now: float) -> Any:
        """Called when a fault begins or ends."""

    # Actions.

    @property
    def now(self) -> float:
        """Virtual time in seconds."""
        return self._now / 1e9

    def port(self, name: str) -> int:
        """The number of the port ``name``, for ``send``."""
        return [port["name"] for port in self.ports].index(name)

    def send(self, data: Union[bytes, Message], after: float = 0.0, port: int = 0) -> None:
        """Sends bytes or a message, ``after`` seconds from now."""
        at = self._now + round(after * 1e9)
        if isinstance(data, Message):
            text = json.dumps({"name": data.name, "fields": _to_json(data.fields)})
            self._put(6, port, at, text.encode())
            return
        for start in range(0, len(data), 0xFFFF):
            self._put(1, port, at, bytes(data[start : start + 0xFFFF]))

    def reply(self, message: Optional[str] = None, **fields: Any) -> Message:
        """A message of the description; without a name, the one with exactly these fields."""
        if message is not None:
            return Message(message, **fields)
        fitting = [
            known["name"]
            for known in self.messages
            if known["from"] != "host" and set(known["fields"]) == set(fields)
        ]
        if len(fitting) != 1:
            raise LookupError(
                f"{len(fitting)} messages of the device have the fields {sorted(fields)}: "
                f"{fitting}; name one"
            )
        return Message(fitting[0], **fields)

    def after(self, seconds: float, method: Callable[..., Any], *arguments: Any) -> None:
        """Calls a method of this device after ``seconds``.

        Other functions are rejected, because a saved state can only contain names of methods.
        """
        name = getattr(method, "__name__", "")
        if getattr(self, name, None) != method:
            raise TypeError(f"after() takes a method of this device, e.g. self.zeroed, not {method!r}")
        self._timers_made += 1
        at = self._now + max(0, round(seconds * 1e9))
        heappush(self._timers, (at, self._timers_made, name, arguments))

    def note(self, rule: str, sentence: str) -> None:
        """Adds a note to the log of the run."""
        self._put(3, 0, self._now, rule.encode() + b"\0" + sentence.encode())

    def violation(self, rule: str, sentence: str, data: bytes = b"") -> None:
        """Reports that the driver broke a rule: the run fails if it allows no violation."""
        body = rule.encode() + b"\0" + sentence.encode()
        self._put(4, 0, self._now, body + (b"\0" + data if data else b""))

    def show(self, name: str, value: float) -> None:
        """Sets a value of ``outputs``."""
        self._put(5, self.outputs.index(name), self._now, _VALUE.pack(value))

    def set_line(self, rate: int, form: str = "8N1", port: int = 0) -> None:
        """Changes the coding of the line."""
        parity = _PARITIES.index(form[1].upper())
        self._put(2, port, self._now, _CODING.pack(16, rate, int(form[0]), parity, int(form[2])))

    def set_open(self, is_open: bool, port: int = 0) -> None:
        """Opens or closes the device's end of the line."""
        self._put(2, port, self._now, bytes([0 if is_open else 1]))

    # Interface to the rig.

    def __init__(self, hello: Dict[str, Any]) -> None:
        self.name = hello["name"]
        self.seed = hello["seed"]
        self.settings = hello["settings"]
        self.ports = hello["ports"]
        self.messages = hello.get("messages") or []
        self.quantities = {}
        self.random = random.Random(f"{self.seed} {self.name}")
        self._quantity_names = hello["quantities"]
        self._now = 0
        self._heard: Dict[int, bytes] = {}
        self._timers: List[Tuple[int, int, str, Tuple[Any, ...]]] = []
        self._timers_made = 0
        self._out: List[Tuple[int, int, int, bytes]] = []

    def _put(self, kind: int, port: int, at: int, body: bytes) -> None:
        if len(body) > 0xFFFF:
            raise ValueError(f"a message or note of {len(body)} bytes, expected at most 65535")
        self._out.append((kind, port, at, body))

    def _say(self, answer: Any, port: int = 0) -> None:
        if answer is None:
            return
        for one in answer if isinstance(answer, (list, tuple)) else [answer]:
            self.send(one, port=port)

    def _happen(self, kind: int, port: int, at: int, body: bytes) -> None:
        # In order of time: earlier timers run first.
        self._run_timers(at)
        self._now = at
        now = at / 1e9
        if kind == 1:
            if self.typed:
                self._say(self.unknown(body, now), port)
            else:
                self._say(self.receive(body, now, port), port)
        elif kind == 2:
            self._say(self.line(_EVENTS[body[0]], now, port), port)
        elif kind == 3:
            begins, figure = _FAULT.unpack_from(body)
            name = body[_FAULT.size :].decode()
            known = None if figure != figure else figure
            self._say(self.fault(name, bool(begins), known, now))
        elif kind == 4:
            self.quantities[self._quantity_names[port]] = _VALUE.unpack(body)[0]
        elif kind == 6:
            text = json.loads(body)
            message = Message(text["name"], **_from_json(text["fields"]))
            method = getattr(self, f"on_{message.name}", None)
            if method is None:
                self.violation("unknown-message", f"the device does not answer {message.name}")
            else:
                self._say(method(message, now), port)

    def _run_timers(self, until: int) -> None:
        while self._timers and self._timers[0][0] <= until:
            at, _, method, arguments = heappop(self._timers)
            self._now = max(self._now, at)
            self._say(getattr(self, method)(*arguments))

    def _exchange(self, now: int, items: List[Tuple[int, int, int, bytes]]) -> int:
        for item in sorted(items, key=lambda item: item[2]):
            self._happen(*item)
        self._run_timers(now)
        self._now = now
        return self._timers[0][0] if self._timers else NEVER

    def _take(self, now: int) -> List[Tuple[int, int, int, bytes]]:
        out, self._out = self._out, []
        # Bytes ended shortly before the rig passed them on; no output may be in the past.
        return [(kind, port, max(at, now), body) for kind, port, at, body in out]

    def _greeting(self) -> Dict[str, Any]:
        greeting: Dict[str, Any] = {
            "hilrig_node": VERSION,
            "save": self.saves,
            "faults": list(self.faults),
            "outputs": list(self.outputs),
        }
        if self.typed:
            greeting["messages"] = True
        return greeting

    def save(self) -> bytes:
        """The complete state as bytes."""
        return pickle.dumps(self.__dict__, protocol=4)

    def load(self, state: bytes) -> None:
        """Loads a state that ``save`` returned."""
        self.__dict__.update(pickle.loads(state))


def _to_json(value: Any) -> Any:
    if isinstance(value, (bytes, bytearray)):
        return {"hex": value.hex()}
    if isinstance(value, dict):
        return {name: _to_json(each) for name, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_to_json(each) for each in value]
    return value


def _from_json(value: Any) -> Any:
    if isinstance(value, dict):
        if list(value) == ["hex"]:
            return bytes.fromhex(value["hex"])
        return {name: _from_json(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_from_json(each) for each in value]
    return value


class _Binary:
    """Messages in their binary form."""

    def __init__(self, source: BinaryIO, sink: BinaryIO) -> None:
        self._source = source
        self._sink = sink

    def request(self) -> Optional[Tuple[str, Any]]:
        head = self._source.read(4)
        if len(head) < 4:
            return None
        body = self._source.read(_HEAD.unpack(head)[0])
        kind = chr(body[0])
        if kind == "X":
            _, now, count = _EXCHANGE.unpack_from(body)
            items, at = [], _EXCHANGE.size
            for _ in range(count):
                what, port, size, time = _ITEM.unpack_from(body, at)
                at += _ITEM.size
                items.append((what, port, time, body[at : at + size]))
                at += size
            return kind, (now, items)
        return kind, body[1:]

    def greeting(self, body: Any) -> Dict[str, Any]:
        hello: Dict[str, Any] = json.loads(body)
        return hello

    def _write(self, kind: bytes, body: bytes) -> None:
        self._sink.write(_HEAD.pack(len(body) + 1) + kind + body)
        self._sink.flush()

    def hello(self, greeting: Dict[str, Any]) -> None:
        self._write(b"h", json.dumps(greeting).encode())

    def exchange(self, next_: int, items: List[Tuple[int, int, int, bytes]]) -> None:
        parts = [struct.pack("<QH", next_, len(items))]
        for kind, port, at, body in items:
            parts.append(_ITEM.pack(kind, port, len(body), at))
            parts.append(body)
        self._write(b"x", b"".join(parts))

    def saved(self, state: bytes) -> None:
        self._write(b"s", state)

    def loaded(self) -> None:
        self._write(b"l", b"")


class _Json:
    """Messages in readable form: one JSON object per line."""

    def __init__(self, source: BinaryIO, sink: BinaryIO, begun: bytes) -> None:
        self._source = source
        self._sink = sink
        self._begun = begun

    def request(self) -> Optional[Tuple[str, Any]]:
        line, self._begun = self._begun + self._source.readline(), b""
        if not line.strip():
            return None
        ((key, value),) = json.loads(line).items()
        if key == "exchange":
            return "X", (value["now"], [self._item(item) for item in value["items"]])
        if key == "load":
            return "L", bytes.fromhex(value)
        return {"hello": "H", "save": "S", "end": "E"}[key], value

    @staticmethod
    def _item(item: Dict[str, Any]) -> Tuple[int, int, int, bytes]:
        port, time = item.get("port", 0), item["time"]
        if "bytes" in item:
            return 1, port, time, bytes.fromhex(item["bytes"])
        if "line" in item:
            return 2, port, time, bytes([_EVENTS.index(item["line"])])
        if "fault" in item:
            figure = float("nan") if item["figure"] is None else item["figure"]
            return 3, 0, time, _FAULT.pack(item["begins"], figure) + item["fault"].encode()
        if "message" in item:
            return 6, port, time, json.dumps(item["message"]).encode()
        return 4, item["quantity"], time, _VALUE.pack(item["value"])

    def greeting(self, value: Any) -> Dict[str, Any]:
        hello: Dict[str, Any] = value
        return hello

    def _write(self, value: Dict[str, Any]) -> None:
        self._sink.write(json.dumps(value).encode() + b"\n")
        self._sink.flush()

    def hello(self, greeting: Dict[str, Any]) -> None:
        self._write({"hello": greeting})

    def exchange(self, next_: int, items: List[Tuple[int, int, int, bytes]]) -> None:
        said = [self._said(*item) for item in items]
        self._write({"exchange": {"next": None if next_ == NEVER else next_, "items": said}})

    @staticmethod
    def _said(kind: int, port: int, at: int, body: bytes) -> Dict[str, Any]:
        if kind == 1:
            return {"bytes": body.hex(), "port": port, "time": at}
        if kind == 2 and body[0] == 16:
            _, rate, data, parity, stop = _CODING.unpack(body)
            form = f"{data}{_PARITIES[parity]}{stop}"
            return {"rate": rate, "format": form, "port": port, "time": at}
        if kind == 2:
            return {"line": _EVENTS[body[0]], "port": port, "time": at}
        if kind in (3, 4):
            rule, sentence, *data_ = body.split(b"\0", 2)
            return {
                "note" if kind == 3 else "violation": rule.decode(),
                "detail": sentence.decode(),
                "bytes": data_[0].hex() if data_ else "",
                "time": at,
            }
        if kind == 6:
            return {"message": json.loads(body), "port": port, "time": at}
        return {"quantity": port, "value": _VALUE.unpack(body)[0], "time": at}

    def saved(self, state: bytes) -> None:
        self._write({"saved": state.hex()})

    def loaded(self) -> None:
        self._write({"loaded": True})


def main(
    device: Callable[[Dict[str, Any]], Device],
    source: Optional[BinaryIO] = None,
    sink: Optional[BinaryIO] = None,
) -> None:
    """Runs ``device`` on standard input and output until the rig ends it."""
    source = sys.stdin.buffer if source is None else source
    if sink is None:
        # Printed text must not mix with the answers.
        sink, sys.stdout = sys.stdout.buffer, sys.stderr
    begun = source.read(1)
    stream: Union[_Binary, _Json]
    if begun == b"{":
        stream = _Json(source, sink, begun)
    elif begun + source.read(3) == b"HRN1":
        stream = _Binary(source, sink)
    else:
        sys.exit("standard input is no stream of hilrig: a scenario starts this program")
    node: Optional[Device] = None
    while True:
        request = stream.request()
        if request is None or request[0] == "E":
            return
        kind, value = request
        if kind == "H":
            hello = stream.greeting(value)
            if hello["hilrig_node"] != VERSION:
                stream.hello({"hilrig_node": VERSION})
                sys.exit(f"the rig speaks version {hello['hilrig_node']}, expected {VERSION}")
            node = device(hello)
            stream.hello(node._greeting())
            node.start()
        elif node is None:
            sys.exit("the rig did not greet")
        elif kind == "X":
            now, items = value
            next_ = node._exchange(now, items)
            stream.exchange(next_, node._take(now))
        elif kind == "S":
            stream.saved(node.save())
        elif kind == "L":
            node.load(value)
            stream.loaded()
