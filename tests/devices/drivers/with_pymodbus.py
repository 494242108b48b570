import logging

from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ModbusException

from common import port, run

logging.disable(logging.CRITICAL)
client = ModbusSerialClient(port(), baudrate=9600, timeout=0.5, retries=0)
client.connect()


def current(client):
    registers = client.read_input_registers(2, count=2, device_id=1).registers
    return client.convert_from_registers(registers, client.DATATYPE.FLOAT32)


def serial(client):
    registers = client.read_input_registers(10, count=2, device_id=1).registers
    return client.convert_from_registers(registers, client.DATATYPE.UINT32)


run(client, {
    "current": current,
    "serial": serial,
    "relay": lambda client: client.read_coils(0, count=1, device_id=1).bits[0],
}, ModbusException)
