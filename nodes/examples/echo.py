from hilrig.device import Device, main


class Echo(Device):
    """Sends back what it hears, 1 ms later."""

    def hear(self, data, now):
        self.send(data, after=0.001)


main(Echo)
