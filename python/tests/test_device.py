"""Devices in Python without a rig: only requests and answers."""

import io
import json
import struct

import pytest

from hilrig.device import Device, main


def hello(**more):
    greeting = {"hilrig_node": 1, "name": "d", "role": "device", "seed": 7, "ports": []}
    return {"hello": {**greeting, "quantities": ["load"], "settings": {}, **more}}


def exchange(now, *items):
    return {"exchange": {"now": now, "items": [{"time": now, **item} for item in items]}}


def played(device, *requests):
    """The answers of ``device`` in readable form."""
    source = io.BytesIO(b"".join(json.dumps(one).encode() + b"\n" for one in requests))
    sink = io.BytesIO()
    main(device, source, sink)
    return [json.loads(line) for line in sink.getvalue().splitlines()]


class Meter(Device):
    ends = b"\n"
    saves = True
    count = 0

    def hear(self, line, now):
        self.count += 1
        self.after(0.5, self.later, line)
        return b"%d at %.3f\n" % (self.count, now)

    def later(self, line):
        return line.upper()


def test_a_line_is_answered_and_a_timer_asks_for_its_time():
    request = {"bytes": b"a\nb".hex(), "port": 0}
    answers = played(Meter, hello(), exchange(10**9, request), exchange(15 * 10**8))
    assert answers[0]["hello"]["save"] is True
    said = answers[1]["exchange"]
    assert bytes.fromhex(said["items"][0]["bytes"]) == b"1 at 1.000\n"
    assert said["next"] == 15 * 10**8
    assert answers[2]["exchange"] == {
        "next": None,
        "items": [{"bytes": b"A".hex(), "port": 0, "time": 15 * 10**8}],
    }


def test_a_fresh_device_goes_on_from_a_saved_state():
    request = {"bytes": b"a\nb".hex(), "port": 0}
    state = played(Meter, hello(), exchange(10**9, request), {"save": True})[2]["saved"]
    rest = {"bytes": b"\n".hex(), "port": 0}
    answers = played(Meter, hello(), {"load": state}, exchange(2 * 10**9, rest))
    items = answers[2]["exchange"]["items"]
    said = [bytes.fromhex(item["bytes"]) for item in items]
    assert said == [b"A", b"2 at 2.000\n"]


class Foreign(Meter):
    def hear(self, line, now):
        # The first has a method name, the second has none, the third is of another device.
        others = {b"f": sorted, b"l": lambda: b"x", b"d": Meter(hello()["hello"]).later}
        self.after(0.5, others[line])


@pytest.mark.parametrize("which", [b"f", b"l", b"d"])
def test_after_takes_a_method_of_the_device_alone(which):
    request = {"bytes": (which + b"\n").hex(), "port": 0}
    with pytest.raises(TypeError, match="a method of this device"):
        played(Foreign, hello(), exchange(10**9, request))


class Typed(Device, description="meter"):
    def on_read(self, request, now):
        return self.reply(volts=request.scale * 2, raw=b"\x01")


MESSAGES = [
    {"name": "read", "from": "host", "fields": ["scale"]},
    {"name": "reading", "from": "device", "fields": ["volts", "raw"]},
]


def test_a_message_is_answered_by_the_message_with_these_fields():
    message = {"message": {"name": "read", "fields": {"scale": 3}}, "port": 0}
    answers = played(Typed, hello(messages=MESSAGES), exchange(5, message))
    assert answers[0]["hello"]["messages"] is True
    [item] = answers[1]["exchange"]["items"]
    assert item["message"] == {"name": "reading", "fields": {"volts": 6, "raw": {"hex": "01"}}}


def test_another_version_is_refused_with_its_own():
    with pytest.raises(SystemExit, match="version 2, expected 1"):
        played(Meter, hello(hilrig_node=2))


def test_the_binary_form_has_the_same_answer():
    def framed(body):
        return struct.pack("<I", len(body)) + body

    item = struct.pack("<BBHQ", 1, 0, 2, 10**9) + b"a\n"
    greeting = b"H" + json.dumps(hello()["hello"]).encode()
    request = b"X" + struct.pack("<QH", 10**9, 1) + item
    sink = io.BytesIO()
    main(Meter, io.BytesIO(b"HRN1" + framed(greeting) + framed(request) + framed(b"E")), sink)
    answers = sink.getvalue()
    first = struct.unpack_from("<I", answers)[0]
    kind, following, count = struct.unpack_from("<BQH", answers, 8 + first)
    assert (chr(kind), following, count) == ("x", 15 * 10**8, 1)
    assert answers.endswith(b"1 at 1.000\n")
