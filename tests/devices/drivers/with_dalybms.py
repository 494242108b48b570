import logging

from common import port, run
from dalybms import DalyBMS

logging.disable(logging.CRITICAL)
bms = DalyBMS()
bms.connect(port())
run(bms, {
    "state": lambda bms: bms.get_soc(),
    "range": lambda bms: bms.get_cell_voltage_range(),
    "celsius": lambda bms: bms.get_temperature_range(),
    "switches": lambda bms: bms.get_mosfet_status(),
    "cells": lambda bms: bms.get_cell_voltages(),
    "errors": lambda bms: bms.get_errors(),
})
