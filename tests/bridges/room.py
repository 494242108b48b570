"""A reader of /scan and /tf as a mapper is one: it places each reading in the room and compares the
points with the walls of scenarios/custom-robot.toml. It also drives to the scenario's waypoint."""

import bisect
import json
import math
import sys

#: The room and the robot's start, from the scenario.
WIDTH_M, HEIGHT_M = 3.0, 2.0
START = (1.0, 1.0)
#: A reading within this distance of a wall hits it: the noise of an XV-11, and that of the wheels.
NEAR_M = 0.06
#: The waypoint is 1.2 m ahead.
AHEAD_M = 1.2
SPEED_M_S = 0.2


class Room:
    """What a reader has received."""

    def __init__(self):
        self.scans, self.clocks, self.odometry = [], [], []
        #: Poses of base_link in odom, and of laser in base_link, by time.
        self.moves, self.mount = [], None

    def clock(self, at):
        self.clocks.append(at)

    def transform(self, parent, child, at, place):
        if (parent, child) == ("odom", "base_link"):
            self.moves.append((at, *place))
        elif (parent, child) == ("base_link", "laser"):
            self.mount = place

    def scan(self, frame, at, angle_min, increment, turn_s, ranges):
        assert frame == "laser" and len(ranges) == 360, (frame, len(ranges))
        self.scans.append((at, angle_min, increment, turn_s, list(ranges)))

    def odom(self, at, x, y, speed, turn):
        self.odometry.append((at, x, y, speed, turn))

    def is_there(self):
        return bool(self.odometry) and self.odometry[-1][1] >= AHEAD_M

    def speed(self):
        """The speed to be commanded now."""
        return 0.0 if self.is_there() else SPEED_M_S

    def points(self, mount):
        """All readings in the world."""
        times = [move[0] for move in self.moves]
        for at, angle_min, increment, turn_s, ranges in self.scans:
            for index, range_m in enumerate(ranges):
                # A mapper drops readings for which tf has no pose.
                when = at + turn_s * index / len(ranges)
                after = bisect.bisect(times, when)
                if not math.isfinite(range_m) or not 0 < after < len(times):
                    continue
                (t0, *one), (t1, *two) = self.moves[after - 1 : after + 1]
                share = (when - t0) / (t1 - t0)
                x, y, heading = (a + share * (b - a) for a, b in zip(one, two))
                angle = mount[2] + angle_min + index * increment
                ahead = mount[0] + range_m * math.cos(angle)
                left = mount[1] + range_m * math.sin(angle)
                yield (
                    START[0] + x + ahead * math.cos(heading) - left * math.sin(heading),
                    START[1] + y + ahead * math.sin(heading) + left * math.cos(heading),
                )

    def share(self, mount):
        """The share of readings that hit a wall of the room."""
        walls = [min(abs(x), abs(x - WIDTH_M), abs(y), abs(y - HEIGHT_M)) for x, y in self.points(mount)]
        return sum(wall <= NEAR_M for wall in walls) / len(walls)

    def judge(self):
        """Prints the figures; the exit code says whether they are those of the room."""
        found = {
            "clocks": len(self.clocks),
            "scans": len(self.scans),
            "odometry": len(self.odometry),
            "on_walls": round(self.share(self.mount), 3),
            # The mutant: a reader that does not know the mount, turned by 30 degrees.
            "on_walls_without_mount": round(self.share((0.0, 0.0, 0.0)), 3),
            "rows": self.drawn(),
        }
        rows = found.pop("rows")
        print("\n".join(rows))
        print(json.dumps(found))
        steps = [b - a for a, b in zip(self.clocks, self.clocks[1:])]
        is_good = (
            found["on_walls"] > 0.95
            and found["on_walls_without_mount"] < 0.6
            and len(self.scans) > 20
            and self.is_there()
            and min(steps) >= 0
            and max(one[3] for one in self.odometry) > SPEED_M_S / 2
        )
        sys.exit(0 if is_good else 1)

    def drawn(self, cell_m=0.1):
        """The map as text, one character per 10 cm."""
        cells = {(math.floor(x / cell_m), math.floor(y / cell_m)) for x, y in self.points(self.mount)}
        columns = range(-2, round(WIDTH_M / cell_m) + 2)
        lines = range(round(HEIGHT_M / cell_m) + 1, -3, -1)
        return ["".join("#" if (x, y) in cells else "." for x in columns) for y in lines]


def heading_of(z, w):
    """The heading of a quaternion about the vertical axis."""
    return 2 * math.atan2(z, w)
