import logging

from LD2410 import LD2410

from common import port, run

radar = LD2410(port(), timeout=1, verbosity=logging.CRITICAL)
run(radar, {
    "version": lambda radar: radar.read_firmware_version(),
    "parameters": lambda radar: radar.read_detection_params(),
    "report": lambda radar: radar.get_radar_data()[0],
})
