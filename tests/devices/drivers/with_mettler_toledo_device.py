from mettler_toledo_device import MettlerToledoDevice, MettlerToledoError

from common import port, run

balance = MettlerToledoDevice(port=port(), timeout=0.5)
run(balance, {
    "weight": lambda balance: balance.get_weight(),
    "model": lambda balance: balance.get_balance_data(),
    "serial": lambda balance: balance.get_serial_number(),
}, MettlerToledoError)
