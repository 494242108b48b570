"""A hardware-in-the-loop rig for small serial robots.

``Rig`` starts ``hilrig up``: the robot's devices appear as serial ports, faults can be added and
ended, and the run is judged at its end. ``Running`` does the same while a program runs on the
ports, ``Bench`` with one device. ``hilrig.aio`` has these calls for asyncio. In pytest use the
fixtures ``rig`` and ``device`` (see ``hilrig.plugin``).
"""

from .bench import Bench
from .binary import BinaryNotFound, find_binary
from .control import Control, Refused
from .result import Check, Result
from .rig import Rig, Running, firmware, run
from .session import Fault, RigError
from .strategies import strategies

__all__ = [
    "Bench",
    "BinaryNotFound",
    "Check",
    "Control",
    "Fault",
    "Refused",
    "Result",
    "Rig",
    "RigError",
    "Running",
    "find_binary",
    "firmware",
    "run",
    "strategies",
]
