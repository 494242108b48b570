"""Drives until the wall ahead is 75 cm away, and stops."""
import os, serial, struct

lidar = serial.Serial(os.environ["HILRIG_PORT_LIDAR"], 115200, timeout=1)
wheels = serial.Serial(os.environ["HILRIG_PORT_WHEELS"], 115200, timeout=1)

def drive(speed):
    frame = bytes([0xAB, 1, 0x80 | 2, speed, speed])
    wheels.write(frame + struct.pack("<H", sum(frame)))
    wheels.read(5)                          # the slave's answer

def ahead_mm():
    while True:                             # index 90 looks ahead: packet 22, third reading
        lidar.read_until(b"\xfa\xb6")
        packet = b"\xfa\xb6" + lidar.read(20)
        words = struct.unpack("<11H", packet) if len(packet) == 22 else [1] + [0] * 10
        total = sum(word << 9 - place for place, word in enumerate(words[:10]))
        if words[10] == (total % 0x8000 + total // 0x8000) % 0x8000 and not packet[13] & 0x80:
            return packet[12] | (packet[13] & 0x3F) << 8

while True:
    drive(25 if ahead_mm() > 750 else 0)
