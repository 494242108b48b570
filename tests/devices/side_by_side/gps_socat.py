"""The receiver by hand: NMEA each second and UBX on request, behind `socat pty,link=dev pty,link=drv`."""
import random
import struct
import time

import serial

line = serial.Serial("dev", 9600, timeout=0.01)
lat, lon, seconds = 48.1173, 11.5167, 45319
received, due = b"", time.monotonic() + 1


def nmea(body):
    total = 0
    for byte in body.encode():
        total ^= byte
    line.write(f"${body}*{total:02X}\r\n".encode())


def degrees(value, width):
    return f"{int(value) * 100 + (value - int(value)) * 60:0{width}.4f}"


def ubx(body):
    a = b = 0
    for byte in body:
        a = a + byte & 255
        b = b + a & 255
    return bytes([a, b])


while True:
    received += line.read(64)
    at = received.find(b"\xB5\x62")
    received = received[at:] if at >= 0 else received[-1:]
    if len(received) >= 8:
        size = 8 + struct.unpack("<H", received[4:6])[0]
        if len(received) >= size:
            body, check = received[2:size - 2], received[size - 2:size]
            if ubx(body) == check and body[:2] == b"\x01\x02":
                height = round(random.gauss(545.4, 1.5) * 1000)
                body = b"\x01\x02" + struct.pack(
                    "<HIiiiiII", 28, seconds * 1000, round(lon * 1e7), round(lat * 1e7), height,
                    height - 47000, 2500, 4000)
                line.write(b"\xB5\x62" + body + ubx(body))
            received = received[size:]
    if time.monotonic() >= due:
        due += 1
        seconds += 1
        hms = f"{seconds // 3600 % 24:02}{seconds // 60 % 60:02}{seconds % 60:02}"
        place = f"{degrees(lat, 9)},N,{degrees(lon, 10)},E"
        nmea(f"GPGGA,{hms}.00,{place},1,08,0.9,{random.gauss(545.4, 1.5):.1f},M,47.0,M,,")
        nmea(f"GPRMC,{hms}.00,A,{place},0.0,0.0,271126,,,A")
