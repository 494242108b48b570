from pylx16a.lx16a import LX16A, ServoError

from common import port, run

LX16A.initialize(port())
servo = LX16A(1)
servo.move(60)
run(servo, {
    "angle": lambda servo: servo.get_physical_angle(),
    "volts": lambda servo: servo.get_vin() / 1000,
    "celsius": lambda servo: servo.get_temp(),
    "limits": lambda servo: servo.get_angle_limits(poll_hardware=True),
}, ServoError)
