import plantower

from common import port, run

sensor = plantower.Plantower(port())


def read(sensor):
    found = sensor.read()
    return found.pm10_std, found.pm25_std, found.pm100_std, found.gr03um, found.gr100um


run(sensor, {"air": read}, plantower.PlantowerException)
