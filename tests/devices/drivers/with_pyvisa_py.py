import pyvisa

from common import port, run

supply = pyvisa.ResourceManager("@py").open_resource(
    f"ASRL{port()}::INSTR", baud_rate=9600, write_termination="\n", read_termination="\n", timeout=500)
supply.write("VOLT 5")
supply.write("CURR 0.3")
supply.write("OUTP 1")
run(supply, {
    "identify": lambda supply: supply.query("*IDN?"),
    "volts": lambda supply: float(supply.query("MEAS:VOLT?")),
    "amps": lambda supply: float(supply.query("MEAS:CURR?")),
    "error": lambda supply: supply.query("SYST:ERR?"),
}, (pyvisa.VisaIOError, ValueError))
