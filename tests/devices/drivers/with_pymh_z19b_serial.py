import mh_z19b.sync

from common import port, run

sensor = mh_z19b.sync.Sensor(port=port(), baudrate=9600, timeout=1)


def read(sensor):
    found = sensor.read_metric()
    return found.co2, found.temperature


run(sensor, {"air": read, "range set": lambda sensor: sensor.set_detection_range(2000)}, AssertionError)
