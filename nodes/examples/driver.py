from hilrig.device import Device, main


class Driver(Device):
    """A driver that weighs each half second: it takes the robot's place, without a port."""

    ends = b"\r\n"

    def start(self):
        self.after(0.5, self.weigh)

    def weigh(self):
        self.after(0.5, self.weigh)
        return b"SI\r\n"

    def hear(self, line, now):
        self.note("weighed", line.decode())


main(Driver)
