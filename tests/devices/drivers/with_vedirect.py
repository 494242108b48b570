import vedirect

from common import port, run


def read(charger):
    charger.refresh()
    return charger.battery_volts, charger.solar_volts, charger.solar_power, charger.device_MPPT_state.name


run(vedirect.VEDirect(port()), {"charger": read}, vedirect.VEDirectException)
