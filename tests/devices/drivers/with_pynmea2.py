import pynmea2
import serial

from common import port, run

line = serial.Serial(port(), 9600, timeout=2)


def sentence(kind, *fields):
    def read(line):
        for _ in range(4):
            text = line.readline().decode("ascii", "replace").strip()
            found = pynmea2.parse(text, check=True)
            if found.sentence_type == kind:
                return [getattr(found, field) for field in fields]
        return None
    return read


run(line, {
    "GGA": sentence("GGA", "latitude", "longitude", "gps_qual", "num_sats"),
    "RMC": sentence("RMC", "status", "latitude"),
}, pynmea2.ParseError, pause=0)
