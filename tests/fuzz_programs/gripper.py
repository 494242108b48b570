"""A gripper behind the register bus, with five planted bugs: two exceptions over its frames, one over
its registers, one endless sleep, and half a checksum."""
import os, struct, sys, time

PORT = os.open(os.environ["HILRIG_DIR"] + "/gripper", os.O_RDWR | os.O_NOCTTY)
registers = [0] * 256
held = b""

def answer(register, data=b""):
    frame = bytes([0xAB, register, (0x80 | len(data)) if data else 0]) + data
    os.write(PORT, frame + struct.pack("<H", sum(frame)))

def write(register, data):
    if register == 0x2A:
        registers[0] = 1000 // data[0]                  # bug 1: ZeroDivisionError
    if len(data) > 100:
        raise OverflowError("frame too long")           # bug 2
    for place, value in enumerate(data):
        registers[register + place] = value             # bug 3: IndexError at the last register
    answer(register)

def take(frame):
    body, (low, _) = frame[:-2], frame[-2:]
    if sum(body) & 0xFF != low:                         # bug 4: the high byte is not looked at
        return answer(0xFF)
    if body[2] & 0x80:
        write(body[1], body[3:])
    else:
        count = body[2] & 0x7F
        answer(body[1], bytes(registers[body[1]:body[1] + count]))

while True:
    got = os.read(PORT, 256)
    held += got
    while held:
        if held[0] != 0xAB:
            held = held[1:]
            continue
        if held[:3] == b"\xab\xab\xab":
            while True:                                 # bug 5: hangs
                time.sleep(1)
        if len(held) < 3:
            break
        length = 5 + (held[2] & 0x7F if held[2] & 0x80 else 0)
        if len(held) < length:
            break
        frame, held = held[:length], held[length:]
        take(frame)
