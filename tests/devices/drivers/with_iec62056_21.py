from iec62056_21.client import Iec6205621Client
from iec62056_21.exceptions import Iec6205621Exception

from common import port, run

meter = Iec6205621Client.with_serial_transport(port=port())
meter.connect()


def readout(meter):
    answer = meter.standard_readout()
    found = [f"{one.address}={one.value}{one.unit or ''}"
             for line in answer.data_block.data_lines for one in line.data_sets]
    return found


run(meter, {"readout": readout}, (Iec6205621Exception, TimeoutError))
