"""Modem lines on a pseudo-terminal, answered on the client's side.

A pseudo-terminal answers the calls that set DTR and RTS with ENOTTY, and clients that run the
lidar's motor by DTR end there. With this folder on PYTHONPATH Python loads this file before the
client, whose code stays as it is. Calls of a real port go through untouched.

HILRIG_DTR  the port that carries the level, e.g. DIR/lidar-dtr of `motor = "dtr"`: a byte 1 is
            high, 0 is low. Without it the calls succeed and lead nowhere.
"""

import errno
import fcntl
import os
import struct
import termios

_ioctl = fcntl.ioctl
_levels = 0
_dtr_port = None


def _carry(levels):
    """Writes the level of DTR where the emulated lidar listens."""
    global _levels, _dtr_port
    _levels = levels
    path = os.environ.get("HILRIG_DTR")
    if path is None:
        return
    if _dtr_port is None:
        _dtr_port = os.open(path, os.O_WRONLY | os.O_NOCTTY | os.O_CLOEXEC)
    os.write(_dtr_port, bytes([bool(levels & termios.TIOCM_DTR)]))


def _answer(request, bits):
    if request == termios.TIOCMBIS:
        _carry(_levels | bits)
    elif request == termios.TIOCMBIC:
        _carry(_levels & ~bits)
    else:
        _carry(bits)
    return 0


def ioctl(fd, request, arg=0, mutate_flag=True):
    """fcntl.ioctl, which sets modem lines where there are none."""
    try:
        return _ioctl(fd, request, arg, mutate_flag)
    except OSError as error:
        sets_lines = request in (termios.TIOCMBIS, termios.TIOCMBIC, termios.TIOCMSET)
        if error.errno not in (errno.ENOTTY, errno.EINVAL) or not sets_lines:
            raise
    return _answer(request, struct.unpack("I", bytes(arg))[0])


fcntl.ioctl = ioctl
