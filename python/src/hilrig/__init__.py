"""A hardware-in-the-loop rig for small serial robots.

``Rig`` starts ``hilrig up``: the robot's devices appear as serial ports, faults can be added and
ended, and the run is judged at its end. In pytest use the fixture ``rig`` (see ``hilrig.plugin``).
"""

from .binary import BinaryNotFound, find_binary
from .control import Control, Refused
from .result import Check, Result
from .rig import Fault, Rig, RigError, run
from .strategies import strategies

__all__ = [
    "BinaryNotFound",
    "Check",
    "Control",
    "Fault",
    "Refused",
    "Result",
    "Rig",
    "RigError",
    "find_binary",
    "run",
    "strategies",
]
