from sensirion_shdlc_driver import ShdlcConnection, ShdlcSerialPort
from sensirion_shdlc_driver.errors import ShdlcError
from shdlc_sps30 import Sps30ShdlcDevice

from common import port, run

sensor = Sps30ShdlcDevice(ShdlcConnection(ShdlcSerialPort(port=port(), baudrate=115200)))
sensor.start_measurement()
run(sensor, {
    "version": lambda sensor: sensor.read_version(),
    "product": lambda sensor: sensor.device_information_product_type(),
    "values": lambda sensor: sensor.read_measured_value(),
    "interval": lambda sensor: sensor.read_auto_cleaning_interval(),
}, ShdlcError)
