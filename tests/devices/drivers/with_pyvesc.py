import warnings

warnings.simplefilter("ignore")
import pyvesc
import serial
from pyvesc.messages import GetValues, SetRPM
from pyvesc.packet.exceptions import CorruptPacket

from common import port, run

line = serial.Serial(port(), 115200, timeout=0.1)


def values(line):
    """As pyvesc's example does it: ask, read, decode what has come."""
    line.write(pyvesc.encode(SetRPM(2500)))
    line.reset_input_buffer()
    line.write(pyvesc.encode_request(GetValues))
    message, consumed = pyvesc.decode(line.read(61))
    if message is None:
        return None
    return message.rpm, message.v_in, message.temp_pcb, message.current_motor, message.mc_fault_code


run(line, {"motor": values}, CorruptPacket)
