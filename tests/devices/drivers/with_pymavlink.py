from pymavlink import mavutil

from common import port, run

link = mavutil.mavlink_connection(port(), baud=57600, source_system=255)


def heartbeat(link):
    found = link.recv_match(type="HEARTBEAT", blocking=True, timeout=3)
    return found and (found.type, found.autopilot, found.base_mode, found.get_srcSystem())


def gain(link):
    link.mav.param_request_read_send(1, 1, b"GAIN", -1)
    found = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=1)
    return found and (found.param_id, found.param_value)


def armed(link):
    link.mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    found = link.recv_match(type="COMMAND_ACK", blocking=True, timeout=1)
    return found and (found.command, found.result)


def pitch(link):
    found = link.recv_match(type="ATTITUDE", blocking=True, timeout=1)
    return found and (round(found.pitch, 4), round(found.yaw, 4))


run(link, {"heartbeat": heartbeat, "gain": gain, "armed": armed, "attitude": pitch})
