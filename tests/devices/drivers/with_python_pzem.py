import minimalmodbus
import serial

from common import port, run
from pzem import PZEM_016

meter = PZEM_016(port())
run(meter, {
    "voltage": lambda meter: meter.voltage,
    "current": lambda meter: meter.current,
    "power": lambda meter: meter.power,
    "frequency": lambda meter: meter.frequency,
    "alarm": lambda meter: meter.has_alarm,
    "threshold": lambda meter: meter.alarm_threshold,
}, (minimalmodbus.ModbusException, IOError, ValueError, serial.SerialException))
