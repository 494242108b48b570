"""A gripper behind the register bus, with five planted bugs: three exceptions, an endless sleep, and
half a checksum."""
import os, struct, time

PORT = os.open(os.environ["HILRIG_DIR"] + "/gripper", os.O_RDWR | os.O_NOCTTY)
registers = [0] * 256
held = b""

def answer(register, data=b""):
    frame = bytes([0xAB, register, (0x80 | len(data)) if data else 0]) + data
    os.write(PORT, frame + struct.pack("<H", sum(frame)))

def write(register, data):
    if not data:
        return answer(register)
    if register & 0x0F == 0x0A:
        registers[0] = 1000 // (data[0] // 8)           # bug 1: ZeroDivisionError
    if len(data) == 127:
        raise OverflowError("frame too long")           # bug 2
    if register == 255:
        registers[256] = data[-1]                       # bug 3: IndexError
    for place, value in enumerate(data):
        registers[(register + place) % 256] = value
    answer(register)

def take(frame):
    body, (low, _) = frame[:-2], frame[-2:]
    if sum(body) & 0xFF != low:                         # bug 4: the high byte is not looked at
        return answer(0xFF)
    if body[2] & 0x80:
        write(body[1], body[3:])
    else:
        count = body[2] & 0x7F
        while body[1] & 0x3F == 0x15 and count > 100:   # bug 5: hangs
            time.sleep(1)
        answer(body[1], bytes(registers[body[1]:body[1] + count]))

while True:
    got = os.read(PORT, 256)
    held += got
    while held:
        if held[0] != 0xAB:
            held = held[1:]
            continue
        if len(held) < 3:
            break
        length = 5 + (held[2] & 0x7F if held[2] & 0x80 else 0)
        if len(held) < length:
            break
        frame, held = held[:length], held[length:]
        take(frame)
