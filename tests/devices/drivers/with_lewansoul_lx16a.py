import lewansoul_lx16a
import serial

from common import port, run

bus = lewansoul_lx16a.ServoController(serial.Serial(port(), 115200, timeout=1), timeout=0.2)
run(bus.servo(1), {
    "position": lambda servo: servo.get_position(),
    "millivolts": lambda servo: servo.get_voltage(),
    "celsius": lambda servo: servo.get_temperature(),
}, lewansoul_lx16a.TimeoutError)
