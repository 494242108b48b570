import PyLidar3

from common import port, run

lidar = PyLidar3.YdLidarX4(port(), chunk_size=2000)
assert lidar.Connect()
information = lidar.GetDeviceInfo()
scans = lidar.StartScanning()


def distances(scans):
    return sorted({distance for distance in next(scans).values() if distance})


run(scans, {
    "version": lambda _: (information["model_number"], information["firmware_version"]),
    "distances": distances,
})
