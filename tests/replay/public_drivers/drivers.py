"""Small programs around public drivers, which are used as they come.

    python drivers.py NAME PORT MODE

Modes: as (as it was captured), late (begins 1.5 s later), slow (waits as long again between requests),
broken (one thing is wrong: a register, a command, a field).
"""
import sys
import time

NAME, PORT, MODE = sys.argv[1:]
BROKEN = MODE == "broken"


def pause(seconds=0.05):
    time.sleep(seconds * (4 if MODE == "slow" else 1))


def minimalmodbus():
    import minimalmodbus

    meter = minimalmodbus.Instrument(PORT, 1)
    meter.serial.baudrate, meter.serial.timeout = 115200, 5
    for _ in range(3):
        print(round(meter.read_float(0, 4), 2), flush=True)
        pause()
        print(round(meter.read_float(0 if BROKEN else 12, 4, 4 if BROKEN else 2), 2), flush=True)
        pause()


def pymodbus():
    from pymodbus.client import ModbusSerialClient

    client = ModbusSerialClient(PORT, baudrate=115200, timeout=5)
    assert client.connect()
    for _ in range(3):
        for register in (0, 13 if BROKEN else 12):
            print(client.read_input_registers(register, count=2, device_id=1).registers, flush=True)
            pause()
    client.close()


def obd():
    import obd

    car = obd.OBD(PORT, baudrate=115200, fast=False, timeout=5)
    for command in (obd.commands.RPM, obd.commands.RUN_TIME if BROKEN else obd.commands.SPEED):
        print(car.query(command, force=True).value, flush=True)
        pause()
    car.close()


def pygmc():
    import pygmc
    import serial

    # At a USB adapter it discards nothing; at a pseudo-terminal, what the tap has not read yet.
    serial.Serial.reset_output_buffer = lambda port: None
    counter = pygmc.GMC320(PORT, timeout=5)
    print(counter.get_version(), flush=True)
    pause()
    for _ in range(3):
        print(counter.get_voltage() if BROKEN else counter.get_cpm(), flush=True)
        pause()
    print(counter.get_serial(), flush=True)


def pynmea2():
    import pynmea2
    import serial

    port = serial.Serial(PORT, 115200, timeout=5)
    for _ in range(15):
        line = port.readline().decode()
        try:
            sentence = pynmea2.parse(line.strip(), check=True)
        except pynmea2.ParseError:
            continue  # The first one may be cut.
        place = sentence.longitude if BROKEN else sentence.latitude
        print(round(place, 6), flush=True)
        pause()


def pyubx2():
    import serial
    from pyubx2 import POLL, UBXMessage, UBXReader

    port = serial.Serial(PORT, 115200, timeout=5)
    reader = UBXReader(port)
    for _ in range(3):
        port.write(UBXMessage("MON" if BROKEN else "NAV", "MON-VER" if BROKEN else "NAV-STATUS",
                              POLL).serialize())
        _, answer = reader.read()
        print(answer.identity, flush=True)
        pause()


def tfmini():
    from tfmini import TFmini

    sensor = TFmini(PORT, mode=TFmini.STD_MODE) if not BROKEN else TFmini(PORT, mode=TFmini.DEC_MODE)
    for _ in range(5):
        print(sensor.read() is not None, flush=True)
        pause()
    sensor.close()


if MODE == "late":
    time.sleep(1.5)
globals()[NAME]()
