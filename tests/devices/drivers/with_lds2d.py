from lds2d import Lidar, LidarError

from common import port, run

lidar = Lidar.open("LD14P", port())
lidar.set_scan_freq(6)
scans = lidar.scans()
next(scans)


def scan(scans):
    found = next(scans)
    return len(found), found.scan_freq_hz, sorted({point.dist_mm for point in found})


run(scans, {"scan": scan}, LidarError)
