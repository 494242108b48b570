//! A robot of your own with a program in this process: two wheels that follow one byte, and a
//! program that drives for a second. Bigger, with car, lidar and map: `tests/outside`.
//!
//! `cargo run --example own_robot`

use hilrig::emulators::world::Wheel;
use hilrig::firmware_core::pose::Pose as Believed;
use hilrig::prelude::*;

const LINE: LineConfig = LineConfig::new_8n1(115_200);

/// Drive of both wheels: the last byte, a signed number up to 127, is the power.
#[derive(Clone, Default)]
struct Wheels(i8);

impl Device for Wheels {
    fn receive(&mut self, _: Port, _: Instant, bytes: &[u8]) {
        self.0 = bytes.last().map_or(self.0, |byte| byte.cast_signed());
    }

    fn poll(&mut self, _: Instant, world: &mut World) {
        for wheel in Wheel::ALL {
            let power = Command::Power(i16::from(self.0) * 2);
            let name = wheel.name();
            world
                .actuate(name, power)
                .expect("the robot has two wheels");
        }
    }

    fn transmit(&mut self, _: Port, _: &mut [u8]) -> usize {
        0
    }

    fn poll_at(&self) -> Option<Instant> {
        None
    }

    fn line_config(&self, _: Port) -> LineConfig {
        LINE
    }

    fn take_events(&mut self) -> Vec<Event> {
        Vec::new()
    }
}

/// Full ahead at once, stop after a second.
#[derive(Clone, Default)]
struct OneSecond {
    orders: Vec<u8>,
    given: usize,
}

const STOP_AT: Instant = Instant::from_secs(1);

impl Master for OneSecond {
    fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}

    fn poll(&mut self, now: Instant) {
        let due = if now < STOP_AT { 1 } else { 2 };
        while self.given < due {
            self.orders.push([100, 0][self.given]);
            self.given += 1;
        }
    }

    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        let len = buf.len().min(self.orders.len());
        buf[..len].copy_from_slice(&self.orders[..len]);
        self.orders.drain(..len).len()
    }

    fn poll_at(&self) -> Option<Instant> {
        (self.given < 2).then_some(STOP_AT)
    }

    fn line_config(&self, _: Port) -> LineConfig {
        LINE
    }

    fn take_work(&mut self) -> Work {
        Work::NONE
    }
}

impl Inspect for OneSecond {
    fn estimate(&self) -> Option<(Instant, Believed)> {
        None
    }

    fn map(&self) -> Option<MapView<'_>> {
        None
    }

    fn mode(&self) -> &'static str {
        if self.given < 2 { "drive" } else { "stop" }
    }

    fn counters(&self, report: &mut dyn FnMut(&'static str, u64)) {
        report("orders", self.given as u64);
    }
}

struct Cart;

impl Robot for Cart {
    fn name(&self) -> &'static str {
        "cart"
    }

    fn about(&self) -> &'static str {
        "two wheels and a program that drives for a second"
    }

    fn wire(&self, plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
        let mut wired = Wired::new(Rig::new(plan.world), CartInstruments);
        let device = End {
            node: wired.rig.add_device("wheels", Wheels::default()),
            port: Port(0),
        };
        let master = match plan.dut {
            Dut::External => wired.open_end("wheels", LINE, "your program"),
            Dut::Internal => End {
                node: wired
                    .rig
                    .add_program("program", Box::<OneSecond>::default()),
                port: Port(0),
            },
        };
        wired.rig.connect("wheels", device, master, 1);
        Ok(wired)
    }
}

/// Data of the cart for page, report and checks.
struct CartInstruments;

impl Instruments for CartInstruments {
    fn axes(&self, rig: &Rig) -> Vec<Axis> {
        let told = rig.device::<Wheels>("wheels").map_or(0, |wheels| wheels.0);
        vec![Axis {
            name: "wheels".into(),
            unit: "of 127",
            set_point: told.into(),
            limit: Some(100.0),
            actual: None,
        }]
    }
}

const SCENARIO: &str = r#"
schema = 1
name = "one-second"
robot = "cart"
duration = "3s"
expect.settle = "500ms"
world.start = { x_m = 1, y_m = 1, heading_deg = 0 }
world.wall = [{ path_m = [[3.0, 0.0], [3.0, 2.0]] }]
"#;

fn main() -> Result<(), Box<dyn core::error::Error>> {
    register_robot(Cart)?;
    let outcome = judge(SCENARIO)?;
    outcome.checks.iter().for_each(|check| println!("{check}"));
    outcome.assert_passed();
    Ok(())
}
