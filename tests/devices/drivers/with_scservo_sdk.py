from scservo_sdk import COMM_SUCCESS, PacketHandler, PortHandler

from common import port, run

line = PortHandler(port())
line.openPort()
line.setBaudRate(1000000)
packets = PacketHandler(0)


class Failed(Exception):
    """What the driver returns as a result that is not a success."""


def checked(answer):
    *value, result, error = answer
    if result != COMM_SUCCESS or error:
        raise Failed(packets.getTxRxResult(result))
    return value[0] if value else True


run(packets, {
    "model": lambda packets: checked(packets.ping(line, 1)),
    "torque": lambda packets: checked(packets.write1ByteTxRx(line, 1, 40, 1)),
    "goal": lambda packets: checked(packets.write2ByteTxRx(line, 1, 42, 1000)),
    "position": lambda packets: checked(packets.read2ByteTxRx(line, 1, 56)),
    "celsius": lambda packets: checked(packets.read1ByteTxRx(line, 1, 63)),
}, Failed)
