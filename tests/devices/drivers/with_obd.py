import logging

import obd

from common import port, run

obd.logger.setLevel(logging.CRITICAL)
car = obd.OBD(port(), baudrate=38400, fast=False, timeout=1)


def value(command):
    return lambda car: car.query(command, force=True).value


run(car, {
    "status": lambda car: car.status(),
    "rpm": value(obd.commands.RPM),
    "speed": value(obd.commands.SPEED),
    "coolant": value(obd.commands.COOLANT_TEMP),
    "codes": value(obd.commands.GET_DTC),
})
