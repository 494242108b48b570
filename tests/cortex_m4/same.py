"""Compares the bytes of two captures: every piece on every line in each direction, with its time.

usage: python3 same.py ONE.pcapng OTHER.pcapng     exit code 1 and the first difference if they differ"""
import struct
import sys

ENHANCED_PACKET = 6


def pieces(path):
    """Line, time and content of each packet."""
    data, at = open(path, "rb").read(), 0
    while at < len(data):
        kind, length = struct.unpack_from("<II", data, at)
        if kind == ENHANCED_PACKET:
            line, high, low, size = struct.unpack_from("<IIII", data, at + 8)
            options = at + 28 + size + -size % 4
            yield line, high << 32 | low, data[at + 28 : at + 28 + size], data[options : at + length - 4]
        at += length


one, other = (list(pieces(path)) for path in sys.argv[1:3])
if not one:
    sys.exit(f"{sys.argv[1]}: no packets: nothing was compared")
for number, (a, b) in enumerate(zip(one, other)):
    if a != b:
        sys.exit(f"packet {number} differs:\n  {a[0]} {a[1]} {a[2].hex()}\n  {b[0]} {b[1]} {b[2].hex()}")
if len(one) != len(other):
    sys.exit(f"{len(one)} packets and {len(other)}")
print(f"{len(one)} packets, {sum(len(packet[2]) for packet in one)} bytes, the same")
