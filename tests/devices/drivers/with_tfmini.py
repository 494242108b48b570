from tfmini import TFmini

from common import port, run

run(TFmini(port(), mode=TFmini.STD_MODE), {"distance": lambda sensor: sensor.read()})
