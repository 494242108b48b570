from senseair_s8.senseair_s8 import SenseairS8

from common import port, run

run(SenseairS8(port()), {"co2": lambda sensor: sensor.co2()})
