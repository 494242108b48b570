"""A bridge to Foxglove: a live WebSocket server, and an MCAP file of the same messages. It needs the
package ``foxglove-sdk`` of PyPI.

::

    pip install foxglove-sdk
    hilrig run robot.toml --realtime --node 'python3 -m hilrig.bridges.foxglove robot.toml'

Open ``ws://localhost:8765`` in Foxglove. Its panel Teleop drives the robot by ``/cmd_vel``.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import Any, Dict, Optional, Tuple, cast

from .model import Model
from .robot import READINGS, Odometry, Scan, Sink, main

#: Frames of REP 105.
ODOM, BASE, LASER = "odom", "base_link", "laser"
#: Topic of the velocity commands, as the panel Teleop sends them.
COMMANDS = "/cmd_vel"


class Foxglove(Sink):
    """A server and a recording."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        try:
            import foxglove
            from foxglove import channels, messages, websocket
        except ImportError as error:
            sys.exit(f"{error}: pip install foxglove-sdk")
        self._messages: Any = messages
        self._commands = Commands()
        self._scan: Any = channels.LaserScanChannel("/scan")
        self._tf: Any = channels.FrameTransformsChannel("/tf")
        self._odom: Any = channels.PoseInFrameChannel("/odom")
        self._mount: Any = None
        self._file: Any = None
        if arguments.mcap is not None:
            self._file = foxglove.open_mcap(arguments.mcap, allow_overwrite=True)
        try:
            self._server: Any = foxglove.start_server(
                name="hilrig",
                host=arguments.host,
                port=arguments.port,
                capabilities=[websocket.Capability.Time, websocket.Capability.ClientPublish],
                server_listener=cast(Any, self._commands),
                supported_encodings=["json"],
            )
        except (OSError, RuntimeError) as error:
            sys.exit(f"--port {arguments.port}: {error}, expected a free port")

    def begin(self, model: Model) -> None:
        if model.lidar is not None:
            lidar = model.lidar
            self._mount = (lidar.x_m, lidar.y_m, lidar.heading_rad)

    def command(self) -> Optional[Tuple[int, float, float]]:
        return self._commands.latest

    def clock(self, now_s: float) -> None:
        self._server.broadcast_time(round(now_s * 1e9))

    def scan(self, scan: Scan) -> None:
        messages = self._messages
        last = scan.angle_min + (READINGS - 1) * scan.angle_increment
        message = messages.LaserScan(
            timestamp=self._time(scan.at_s),
            frame_id=LASER,
            pose=self._pose((0.0, 0.0, 0.0)),
            start_angle=scan.angle_min,
            end_angle=last,
            ranges=scan.ranges,
            intensities=scan.strengths,
        )
        self._scan.log(message, log_time=round(scan.at_s * 1e9))

    def odometry(self, odometry: Odometry) -> None:
        messages = self._messages
        place = (odometry.x_m, odometry.y_m, odometry.heading_rad)
        moved = [self._transform(ODOM, BASE, place, odometry.at_s)]
        if self._mount is not None:
            moved.append(self._transform(BASE, LASER, self._mount, odometry.at_s))
        at_ns = round(odometry.at_s * 1e9)
        self._tf.log(messages.FrameTransforms(transforms=moved), log_time=at_ns)
        message = messages.PoseInFrame(
            timestamp=self._time(odometry.at_s), frame_id=ODOM, pose=self._pose(place)
        )
        self._odom.log(message, log_time=at_ns)

    def end(self) -> None:
        self._server.stop()
        if self._file is not None:
            self._file.close()

    def _time(self, at_s: float) -> Any:
        nanoseconds = round(at_s * 1e9)
        return self._messages.Timestamp(nanoseconds // 10**9, nanoseconds % 10**9)

    def _rotation(self, heading: float) -> Any:
        return self._messages.Quaternion(z=math.sin(heading / 2), w=math.cos(heading / 2))

    def _pose(self, place: Tuple[float, float, float]) -> Any:
        messages = self._messages
        position = messages.Vector3(x=place[0], y=place[1])
        return messages.Pose(position=position, orientation=self._rotation(place[2]))

    def _transform(
        self, parent: str, child: str, place: Tuple[float, float, float], at_s: float
    ) -> Any:
        return self._messages.FrameTransform(
            timestamp=self._time(at_s),
            parent_frame_id=parent,
            child_frame_id=child,
            translation=self._messages.Vector3(x=place[0], y=place[1]),
            rotation=self._rotation(place[2]),
        )


class Commands:
    """The velocity commands of all clients: a listener of the server."""

    def __init__(self) -> None:
        self.latest: Optional[Tuple[int, float, float]] = None
        self._topics: Dict[Tuple[int, int], str] = {}

    def on_client_advertise(self, client: Any, channel: Any) -> None:
        self._topics[client.id, channel.id] = channel.topic

    def on_client_unadvertise(self, client: Any, client_channel_id: int) -> None:
        self._topics.pop((client.id, client_channel_id), None)

    def on_message_data(self, client: Any, client_channel_id: int, data: bytes) -> None:
        if self._topics.get((client.id, client_channel_id)) != COMMANDS:
            return
        try:
            twist = json.loads(data)
            speed, turn = float(twist["linear"]["x"]), float(twist["angular"]["z"])
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            print(f"{COMMANDS}: {error}, expected a Twist as JSON", file=sys.stderr)
            return
        number = self.latest[0] + 1 if self.latest is not None else 1
        self.latest = (number, speed, turn)

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """No effect: each client gets all topics that it asks for."""

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """No effect."""


def port(text: str) -> int:
    """A number of a port."""
    number = int(text)
    if not 0 < number < 1 << 16:
        raise argparse.ArgumentTypeError(f"is {text}, expected 1 to 65535")
    return number


if __name__ == "__main__":
    main(
        __doc__.split(":")[0],
        Foxglove,
        host={"default": "127.0.0.1", "help": "address of the server (default: %(default)s)"},
        port={"type": port, "default": 8765, "help": "port of the server (default: %(default)s)"},
        mcap={"metavar": "FILE", "help": "also write the messages to this MCAP file"},
    )
