"""Reads both chips through the frames of docs/pty.md, with the calls of the library smbus2, and
judges the answers by the chips' data sheets.

usage: chips.py DIRECTORY    of `hilrig up bench.toml`
"""

import os
import select
import sys
import time
import tty

FRAME = 0x01
# Eight bits on the wire, seven in the calls of smbus2.
IMU, RANGER = 0x68, 0x70
# Data sheet of the MPU-6050: register, value written, value read back. Only bits that exist are
# written.
KEPT = [
    ("SMPLRT_DIV", 0x19, 0x07, 0x07),
    ("GYRO_CONFIG", 0x1B, 0x18, 0x18),
    ("ACCEL_CONFIG", 0x1C, 0x10, 0x10),
    ("FIFO_EN", 0x23, 0x78, 0x78),
    ("INT_PIN_CFG", 0x37, 0x02, 0x02),
    ("INT_ENABLE", 0x38, 0x01, 0x01),
]


class SMBus:
    """Calls of smbus2, on the port of a chip."""

    def __init__(self, path):
        self.port = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.port)

    def _take(self, count):
        data = b""
        while len(data) < count:
            if not select.select([self.port], [], [], 5)[0]:
                raise TimeoutError(f"{len(data)} of {count} bytes of an answer")
            data += os.read(self.port, count - len(data))
        return data

    def _transfer(self, message):
        os.write(self.port, bytes([FRAME, len(message)]) + message)
        frame, status, length = self._take(3)
        assert frame == FRAME, frame
        data = self._take(length)
        if status != 0:
            raise OSError(121, "Remote I/O error: no acknowledge")
        return data

    def write_byte_data(self, address, register, value):
        self._transfer(bytes([address << 1, register, value]))

    def read_i2c_block_data(self, address, register, length):
        # Both at once, as a terminal may join them: the frames keep them apart.
        select_register = bytes([address << 1, register])
        read = bytes([address << 1 | 1, length])
        os.write(self.port, bytes([FRAME, 2]) + select_register + bytes([FRAME, 2]) + read)
        statuses = []
        for expected in (0, length):
            frame, status, count = self._take(3)
            assert frame == FRAME and count == (0 if status else expected), (frame, status, count)
            data = self._take(count)
            statuses.append(status)
        # Both answers are taken first: a stale one would be that of the next call.
        if any(statuses):
            raise OSError(121, "Remote I/O error: no acknowledge")
        return list(data)

    def read_byte_data(self, address, register):
        return self.read_i2c_block_data(address, register, 1)[0]


def judge(what, found, expected):
    is_right = found == expected if not callable(expected) else expected(found)
    print(f"{'ok  ' if is_right else 'FAIL'} {what}: {found}")
    return 0 if is_right else 1


def imu(bus):
    wrong = judge("WHO_AM_I", bus.read_byte_data(IMU, 0x75), 0x68)
    wrong += judge("PWR_MGMT_1 after power-up", bus.read_byte_data(IMU, 0x6B), 0x40)
    bus.write_byte_data(IMU, 0x6B, 0)
    for name, register, value, kept in KEPT:
        bus.write_byte_data(IMU, register, value)
        wrong += judge(name, bus.read_byte_data(IMU, register), kept)
    time.sleep(0.2)
    wrong += judge("INT_STATUS, data ready", bus.read_byte_data(IMU, 0x3A) & 1, 1)
    high, low = bus.read_i2c_block_data(IMU, 0x3F, 2)
    lift = int.from_bytes(bytes([high, low]), "big", signed=True)
    # ACCEL_CONFIG 0x10 is a range of 8 g: 4096 per g.
    wrong += judge("acceleration upwards", lift, lambda value: abs(value - 4096) < 200)
    # 8 kHz / 200 are 40 samples of 12 bytes a second; the FIFO has 1024 bytes.
    bus.write_byte_data(IMU, 0x19, 199)
    began = time.monotonic()
    bus.write_byte_data(IMU, 0x6A, 0x44)
    time.sleep(0.5)
    high, low = bus.read_i2c_block_data(IMU, 0x72, 2)
    count = high << 8 | low
    # The rig's clock never runs ahead of this one, but may be stopped.
    most = 12 * (40 * (time.monotonic() - began) + 2)
    wrong += judge("bytes in the FIFO", count, lambda value: 0 < value <= most and value % 12 == 0)
    try:
        bus.read_byte_data(IMU + 1, 0x75)
        wrong += judge("another address", "acknowledged", "not acknowledged")
    except OSError as error:
        wrong += judge("another address", error.errno, 121)
    return wrong


def wait_until_idle(bus):
    """Polls the software revision: a chip that measures does not respond, and a bus without an
    answer reads 0xFF."""
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        try:
            if bus.read_byte_data(RANGER, 0) != 0xFF:
                return
        except OSError:
            pass
        time.sleep(0.005)
    raise TimeoutError("the ranger still measures after 5 s")


def ranger(bus):
    wrong = judge("software revision", bus.read_byte_data(RANGER, 0), lambda value: 0 < value < 255)
    for range_register, reach in ((140, "6 m"), (23, "1 m")):
        bus.write_byte_data(RANGER, 2, range_register)
        bus.write_byte_data(RANGER, 0, 0x51)
        wait_until_idle(bus)
        high, low = bus.read_i2c_block_data(RANGER, 2, 2)
        what = f"centimetres to a wall 1 m away, reach {reach}"
        wrong += judge(what, high << 8 | low, lambda value: abs(value - 100) <= 2)
    return wrong


def main():
    folder = sys.argv[1]
    wrong = imu(SMBus(f"{folder}/imu")) + ranger(SMBus(f"{folder}/ranger"))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
