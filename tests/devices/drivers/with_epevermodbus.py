import minimalmodbus
from epevermodbus.driver import EpeverChargeController
from retrying import RetryError

from common import port, run

charger = EpeverChargeController(port(), 1)
run(charger, {
    "panel": lambda charger: (charger.get_solar_voltage(), charger.get_solar_power()),
    "battery": lambda charger: (charger.get_battery_voltage(), charger.get_battery_current()),
    "celsius": lambda charger: charger.get_battery_temperature(),
    "load": lambda charger: charger.get_load_power(),
    "charge": lambda charger: charger.get_battery_state_of_charge(),
}, (minimalmodbus.ModbusException, RetryError, IOError, ValueError))
