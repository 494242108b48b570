import logging

import pygmc

from common import port, run

logging.disable(logging.CRITICAL)
counter = pygmc.GMC320(port(), timeout=1)
run(counter, {
    "version": lambda counter: counter.get_version(),
    "cpm": lambda counter: counter.get_cpm(),
    "volts": lambda counter: counter.get_voltage(),
    "serial": lambda counter: counter.get_serial(),
    "celsius": lambda counter: counter.get_temp(),
})
