"""Driver of NAME, with Python's own library alone: it sets the target and reads reports."""

import os
import select
import struct
import sys
import time
import tty

PORT = sys.argv[1] if len(sys.argv) > 1 else os.path.join(os.environ["HILRIG_DIR"], "NAME")
REPORT = struct.Struct("<BhhB")


def crc16_modbus(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return struct.pack("<H", crc)


def frame(body):
    whole = b"\xa5\x5a" + bytes([len(body)]) + body
    return whole + crc16_modbus(whole)


def ask(port, body, timeout=0.5, tries=3):
    """The values of the report; asks again after silence, a damaged frame, or another message."""
    for _ in range(tries):
        os.write(port, frame(body))
        data, has_frame, until = b"", False, time.monotonic() + timeout
        while (left := until - time.monotonic()) > 0:
            if not has_frame and select.select([port], [], [], left)[0]:
                data += os.read(port, 256)
            start = data.find(b"\xa5\x5a")
            has_frame = 0 <= start < len(data) - 2 and len(data) >= start + 5 + data[start + 2]
            if has_frame:
                found = data[start : start + 5 + data[start + 2]]
                is_report = len(found) == 5 + REPORT.size and found[3] == 0x81
                if crc16_modbus(found[:-2]) == found[-2:] and is_report:
                    return REPORT.unpack(found[3:-2])
                data = data[start + 1 :]
    raise TimeoutError(f"no reply to {body.hex()}")


def main():
    port = os.open(PORT, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(port)
    body = b"\x02" + struct.pack("<h", 2250)
    while True:
        _, temperature, target, heating = ask(port, body)
        print(f"{temperature / 100:.2f} C, target {target / 100:.2f} C, heating {heating}", flush=True)
        body = b"\x01"
        time.sleep(0.3)


main()
