from pytrinamic.connections.serial_tmcl_interface import SerialTmclInterface
from pytrinamic.tmcl import TMCLReplyChecksumError, TMCLReplyStatusError

from common import port, run

module = SerialTmclInterface(port(), timeout_s=0.5)


def max_speed(module):
    module.set_axis_parameter(4, 0, 30000)
    return module.get_axis_parameter(4, 0)


run(module, {
    "max speed": max_speed,
    "moved": lambda module: (module.move_to(0, -1234), module.get_axis_parameter(1, 0, signed=True)),
}, (TMCLReplyChecksumError, TMCLReplyStatusError, RuntimeError))
