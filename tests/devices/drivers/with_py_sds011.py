from common import port, run
from sds011 import SDS011

run(SDS011(port()), {"air": lambda sensor: sensor.query()})
