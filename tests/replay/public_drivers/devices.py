"""Devices for public drivers: each answers on a serial port as its documentation says.

    python devices.py NAME PORT

Modbus: "MODBUS over Serial Line" 1.02. ELM327: its data sheet. GQ GMC: GQ-RFC1201. TFmini: its product
manual. NMEA 0183 sentences and UBX frames: the receiver descriptions of u-blox.
"""
import struct
import sys
import threading
import time

import serial


def modbus(port):
    """A meter: function 4, volts at 0 and watts at 12, as floats."""
    registers = {0: struct.pack(">f", 230.1), 12: struct.pack(">f", 57.5)}
    while True:
        request = port.read(8)
        slave, function, register, count = struct.unpack(">BBHH", request[:6])
        data = registers.get(register)
        if data is None:
            answer = bytes([slave, function | 0x80, 2])
        else:
            answer = bytes([slave, function, 2 * count]) + data
        time.sleep(0.01)
        port.write(answer + struct.pack("<H", crc(answer)))


def crc(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value


def elm(port):
    """An adapter in a car: 1,726 turns a minute, 50 km/h."""
    answers = {
        "ATZ": "\r\rELM327 v1.5", "ATRV": "12.6V", "ATDPN": "A6",
        "0100": "7E8 06 41 00 BE 3E B8 11", "010C": "7E8 04 41 0C 1A F8",
        "010D": "7E8 03 41 0D 32", "0120": "NO DATA", "0600": "NO DATA", "0900": "NO DATA",
    }
    line = b""
    while True:
        line += port.read(1)
        if not line.endswith(b"\r"):
            continue
        command = line.decode("latin1").strip().replace(" ", "").upper()
        line = b""
        answer = answers.get(command[:4] if command[:2] == "01" else command)
        if answer is None:
            answer = "OK" if command.startswith("AT") else "NO DATA"
        time.sleep(0.02)
        port.write(f"{answer}\r\r>".encode())


def geiger(port):
    """A counter of 28 pulses a minute; the figure rises by one at each question."""
    command, pulses = b"", 28
    while True:
        command += port.read(1)
        if not command.endswith(b">>"):
            continue
        time.sleep(0.01)
        if command.endswith(b"<GETVER>>"):
            port.write(b"GMC-320Re 4.19")
        elif command.endswith(b"<GETCPM>>"):
            port.write(struct.pack(">H", pulses))
            pulses += 1
        elif command.endswith(b"<GETSERIAL>>"):
            port.write(bytes.fromhex("f4883c4d2e1a05"))
        elif command.endswith(b"<GETVOLT>>"):
            port.write(bytes([42]))
        command = b""


def nmea(port):
    """A receiver that says where it is, ten times a second, the minutes going up."""
    for number in range(100_000):
        body = f"GPGGA,120000.{number % 100:02},4807.{number:03},N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"
        total = 0
        for byte in body.encode():
            total ^= byte
        port.write(f"${body}*{total:02X}\r\n".encode())
        time.sleep(0.1)


def ubx(port):
    """A receiver that is polled for NAV-STATUS and MON-VER."""
    sync = b"\xB5\x62"
    buffer, seconds = b"", 1000
    while True:
        buffer += port.read(1)
        if len(buffer) < 8 or not buffer.startswith(sync):
            buffer = buffer[-1:] if buffer[-1:] == sync[:1] else buffer if len(buffer) < 8 else b""
            continue
        kind, buffer = buffer[2:4], b""
        if kind == b"\x01\x03":
            payload = struct.pack("<IBBBBII", seconds, 3, 1, 0, 0, 0, 0)
            seconds += 1000
        else:
            payload = b"EXT CORE 3.01".ljust(30, b"\0") + b"00080000".ljust(10, b"\0")
        body = kind + struct.pack("<H", len(payload)) + payload
        a = b = 0
        for byte in body:
            a = a + byte & 255
            b = b + a & 255
        time.sleep(0.02)
        port.write(sync + body + bytes([a, b]))


def tfmini(port):
    """A range finder: 100 frames a second, the distance going down; commands are echoed."""
    def speak():
        for number in range(1_000_000):
            frame = struct.pack("<2sHHBB", b"YY", 1200 - number % 1000, 900, 7, 0)
            with lock:
                port.write(frame + bytes([sum(frame) & 255]))
            time.sleep(0.01)

    lock = threading.Lock()
    threading.Thread(target=speak, daemon=True).start()
    while True:
        command = port.read(8)
        if len(command) == 8:
            with lock:
                port.write(command[:3] + b"\x01" + command[4:])


if __name__ == "__main__":
    name, path = sys.argv[1:]
    device = {"minimalmodbus": modbus, "pymodbus": modbus, "obd": elm, "pygmc": geiger,
              "pynmea2": nmea, "pyubx2": ubx, "tfmini": tfmini}[name]
    opened = serial.Serial(path, 115200)
    print("ready", flush=True)
    device(opened)
