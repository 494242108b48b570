from dynamixel_sdk import COMM_SUCCESS, PacketHandler, PortHandler

from common import port, run

line = PortHandler(port())
line.openPort()
line.setBaudRate(57600)
packets = PacketHandler(2.0)


class Failed(Exception):
    """What the driver returns as a result that is not a success."""


def checked(answer):
    *value, result, error = answer
    if result != COMM_SUCCESS or error:
        raise Failed(packets.getTxRxResult(result))
    return value[0] if value else True


run(packets, {
    "model": lambda packets: checked(packets.ping(line, 1)),
    "torque": lambda packets: checked(packets.write1ByteTxRx(line, 1, 64, 1)),
    "goal": lambda packets: checked(packets.write4ByteTxRx(line, 1, 116, 1000)),
    "position": lambda packets: checked(packets.read4ByteTxRx(line, 1, 132)),
    "volts": lambda packets: checked(packets.read2ByteTxRx(line, 1, 144)) / 10,
}, Failed)
