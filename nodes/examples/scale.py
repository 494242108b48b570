from hilrig.device import Device, main

class Scale(Device):
    """A balance that speaks MT-SICS, drifts, and is busy for a second when it zeroes."""
    ends, faults, outputs, saves = b"\r\n", ("draught",), ("net_g",), True

    def start(self):
        self.zero_g, self.busy_until, self.state = 0.0, 0.0, b"S"

    def net_g(self, now):
        return self.settings["load_g"] + 0.01 * (now // 0.5) - self.zero_g

    def fault(self, name, begins, figure, now):
        self.state = b"D" if begins else b"S"

    def hear(self, line, now):
        if now < self.busy_until:
            self.violation("too-fast", line.decode("latin-1") + " came while the scale is busy")
        elif line == b"SI":
            self.show("net_g", self.net_g(now))
            self.send(b"S %s %10.2f g\r\n" % (self.state, self.net_g(now)), after=0.03)
        elif line == b"ZI":
            self.busy_until = now + 1.0
            self.after(1.0, self.zeroed)
        else:
            self.send(b"ES\r\n", after=0.03)

    def zeroed(self):
        self.zero_g += self.net_g(self.now)
        return b"ZI S\r\n"

main(Scale)
