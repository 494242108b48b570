import serial
from pyubx2 import POLL, UBXMessage, UBXReader
from pyubx2.exceptions import UBXMessageError, UBXParseError, UBXStreamError

from common import port, run

line = serial.Serial(port(), 9600, timeout=0.5)
reader = UBXReader(line, protfilter=2, quitonerror=2)


def posllh(reader):
    line.reset_input_buffer()
    line.write(UBXMessage("NAV", "NAV-POSLLH", POLL).serialize())
    _, found = reader.read()
    return found and (found.identity, found.lat, found.lon)


run(reader, {"posllh": posllh}, (UBXMessageError, UBXParseError, UBXStreamError))
