"""Runs a public driver against its device, and prints what it reads.

A driver's program says how the driver is opened, what it reads, and with which errors it reports a
frame that it cannot use. `MODE` chooses what is done:

plain   each value is read once; an error ends the program
fuzz    the values are read again and again; an error that the driver reports is passed over
faults  the same for `SECONDS` of time, with a line for each value and each error
"""
import os
import sys
import time

MODE = os.environ.get("MODE", "plain")
SECONDS = float(os.environ.get("SECONDS", "26"))


def port(link="dev"):
    """The path of the device's port."""
    return os.path.join(os.environ["HILRIG_DIR"], link)


def run(device, readings, errors=(), pause=0.2):
    """Reads `readings`, functions of `device` by name; `errors` are those that the driver reports."""
    if MODE == "plain":
        for name, read in readings.items():
            print(name, shown(read(device)), flush=True)
        return
    begun = time.monotonic()
    while MODE == "fuzz" or time.monotonic() < begun + SECONDS:
        for name, read in readings.items():
            try:
                print(name, shown(read(device)), flush=True)
            except errors as error:
                print("noticed", name, type(error).__name__, flush=True)
            except Exception as error:
                if MODE == "fuzz":
                    raise
                print("CRASH", name, f"{type(error).__name__}: {error}", flush=True)
            time.sleep(pause)
    sys.exit(0)


def shown(value):
    """A value as one line; floats without what binary fractions add."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return " ".join(f"{key}={shown(each)}" for key, each in value.items())
    if isinstance(value, (list, tuple)):
        return " ".join(shown(each) for each in value)
    return str(value).replace("\n", "\\n")
