from gantrix.transport import GrblError, GrblTransport

from common import port, run

machine = GrblTransport(port())
machine.connect()


def sent(line):
    return lambda machine: machine.send(line, timeout=1)


run(machine, {
    "home": lambda machine: machine.send("$H", timeout=5),
    "move": sent("G0 X10.5 Y-2"),
    "tool": sent("M3 S1000"),
    "off": sent("M5"),
}, GrblError)
