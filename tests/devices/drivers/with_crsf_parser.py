import contextlib
import io

import serial
from crsf_parser import CRSFParser, PacketValidationStatus
from crsf_parser.payloads import PacketsTypes

from common import port, run

line = serial.Serial(port(), 420000, timeout=0.5)
found = {}


def consume(frame, status):
    if status == PacketValidationStatus.VALID:
        found[frame.header.type] = frame.payload


parser = CRSFParser(consume)
waiting = bytearray()


def newest(kind):
    def read(parser):
        found.clear()
        for _ in range(60):
            waiting.extend(line.read(16))
            with contextlib.redirect_stdout(io.StringIO()):
                parser.parse_stream(waiting)
            if kind in found:
                return found[kind]
        return None
    return read


def part(kind, *names):
    read = newest(kind)
    return lambda parser: (lambda payload: payload and tuple(payload[name] for name in names))(read(parser))


def channels(parser):
    payload = newest(PacketsTypes.RC_CHANNELS_PACKED)(parser)
    return payload and (payload.channels[-1], payload.channels[-2])


run(parser, {
    "link": part(PacketsTypes.LINK_STATISTICS, "uplink_link_quality", "uplink_snr"),
    "battery": part(PacketsTypes.BATTERY_SENSOR, "voltage", "current", "capacity", "remaining"),
    "channels": channels,
})
