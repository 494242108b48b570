from hilrig.device import Device, main


class Scale(Device, description="mt-sics"):
    """A balance whose frames the rig reads and writes, as the description says."""

    def start(self):
        self.zero_g = 0.0

    def on_weigh_now(self, request, now):
        return self.reply("stable", net=100.25 + 0.01 * now - self.zero_g)

    def on_zero_now(self, request, now):
        self.zero_g = 100.25 + 0.01 * now
        return self.reply("zeroed_now")


main(Scale)
