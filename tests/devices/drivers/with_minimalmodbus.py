import minimalmodbus

from common import port, run

meter = minimalmodbus.Instrument(port(), 1)
meter.serial.baudrate, meter.serial.timeout = 9600, 0.5
run(meter, {
    "current": lambda meter: meter.read_float(2, 4),
    "power": lambda meter: meter.read_float(4, 4),
    "alarm": lambda meter: meter.read_register(1, 1),
    "label": lambda meter: meter.read_string(3, 4).rstrip("\0"),
}, (minimalmodbus.ModbusException, IOError, ValueError))
