//! The car as a robot: its wiring, possible orders, and the limits that its checker enforces.

use hilrig::prelude::*;

use crate::board::{self, Board};
use crate::program::{Arc, Figures};
use crate::turret::{TurretFormat, TurretScans};

/// `robot = "car"`.
pub struct Car;

fn figures() -> AckermannConfig {
    AckermannConfig::default().ideal()
}

impl Robot for Car {
    fn name(&self) -> &'static str {
        "car"
    }

    fn about(&self) -> &'static str {
        "car with a turret lidar and a servo board; drives an arc"
    }

    fn chassis(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Option<Box<dyn Chassis>>, ScenarioError> {
        let car = Ackermann::new(figures(), scenario.seed);
        let bad = |error: hilrig::emulators::world::BodyError| {
            source.invalid(source.find("robot"), "robot", error.to_string())
        };
        Ok(Some(Box::new(car.map_err(bad)?)))
    }

    fn wire(&self, plan: WirePlan<'_>) -> Result<Wired, ScenarioError> {
        let WirePlan {
            scenario,
            source,
            world,
            dut,
            ..
        } = plan;
        let kind = device_kind("turret").expect("registered together");
        let turret = scenario.build_device("turret", kind, source)?;
        let (start, info) = (world.pose(), turret.ports[0]);
        let mut rig = Rig::new(world);
        let turret = End {
            node: rig.add_boxed_device("turret", turret.device),
            port: info.port,
        };
        let servo = End {
            node: rig.add_device("board", Board::default()),
            port: Port(0),
        };
        let mut wired = Wired::new(rig, CarInstruments);
        let [lidar, board] = match dut {
            Dut::External => [
                wired.open_end("turret", info.line, info.connect),
                wired.open_end("board", board::LINE, info.connect),
            ],
            Dut::Internal => {
                let figures = Figures {
                    tick_m: figures().tick_m(),
                    wheelbase_m: figures().wheelbase_m,
                };
                let program = Box::new(Arc::new(figures, start));
                let node = wired.rig.add_program("program", program);
                [Arc::LIDAR, Arc::BOARD].map(|port| End { node, port })
            }
        };
        wired.rig.connect("turret", turret, lidar, info.piece);
        wired.rig.connect("board", servo, board, 1);
        Ok(wired)
    }
}

struct CarInstruments;

impl Instruments for CarInstruments {
    fn axes(&self, rig: &Rig) -> Vec<Axis> {
        let told = rig
            .device::<Board>("board")
            .map_or([0; 2], |board| board.told);
        let actual = |index| Some(rig.world.chassis().actual(index));
        let axis = |name: &'static str, unit, set_point, limit, actual| Axis {
            name: name.into(),
            unit,
            set_point,
            limit: Some(limit),
            actual,
        };
        let degrees = actual(1).map(f64::to_degrees);
        vec![
            axis("steering", "deg", told[0].into(), 25.0, degrees),
            axis("drive", "m/s", f64::from(told[1]) / 100.0, 1.2, actual(0)),
        ]
    }

    fn panels(&self, rig: &Rig) -> Vec<Panel> {
        let Some(board) = rig.device::<Board>("board") else {
            return Vec::new();
        };
        let row = |name: &'static str, value: i32, unit: &'static str| PanelRow {
            name: name.into(),
            address: None,
            value: value.to_string(),
            unit: unit.into(),
        };
        vec![Panel {
            name: "servo board".to_owned(),
            rows: vec![
                row("steer", board.told[0].into(), "deg"),
                row("drive", board.told[1].into(), "cm/s"),
                row("way", board.count, "counts"),
            ],
        }]
    }

    /// A line from the car to half a metre ahead.
    fn overlays(&self, rig: &Rig) -> Vec<Overlay> {
        let pose = rig.world.pose();
        let (sin, cos) = pose.theta.sin_cos();
        let ahead = [pose.x + 0.5 * cos, pose.y + 0.5 * sin];
        let nothing = Overlay::new("ahead", OverlayRole::Planned);
        vec![nothing.line([[pose.x, pose.y], ahead])]
    }

    fn scanner(&self, _: &Rig) -> Option<(String, Box<dyn ScanDecoder>)> {
        Some(("turret".to_owned(), Box::<TurretScans>::default()))
    }

    fn codec(&self, _: &Rig, link: &str) -> Option<&'static Codec> {
        hilrig::codec::find(TurretFormat::NAME).filter(|_| link == "turret")
    }

    fn checkers(&self, _: &mut Rig) -> Vec<Box<dyn Checker>> {
        vec![Box::new(SlowEnough { fastest: 0.0 })]
    }
}

/// Maximum speed of the car, m/s.
const FASTEST: f64 = 0.5;

struct SlowEnough {
    fastest: f64,
}

impl Checker for SlowEnough {
    fn observe(&mut self, look: &Look<'_>) {
        self.fastest = self.fastest.max(look.rig.world.speed());
    }

    fn verdict(&self) -> Check {
        let detail = format!("{:.2} m/s at most, limit {FASTEST}", self.fastest);
        Check::new("slow-enough", self.fastest <= FASTEST, detail).if_observed(self.fastest > 0.0)
    }
}
