import minimalmodbus

from common import port, run

units = [minimalmodbus.Instrument(port(), address) for address in (1, 2, 3)]
for unit in units:
    unit.serial.baudrate, unit.serial.timeout = 9600, 0.3


def current(index):
    def read(units):
        try:
            return units[index].address, units[index].read_float(2, 4)
        except minimalmodbus.NoResponseError as error:
            return type(error).__name__
    return read


run(units, {"first": current(0), "second": current(1), "third": current(2)},
    (minimalmodbus.ModbusException, IOError, ValueError))
