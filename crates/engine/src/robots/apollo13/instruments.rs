//! The interface of the robot.

use core::time::Duration;

use emulators::car_board::{CarBoard, steering};
use emulators::world::Pose;
use firmware_core::robots::apollo13::Apollo13;
use protocols::Instant;
use protocols::car_board::{Level, Steering};

use super::overlays;
use super::phone::Phone;
use super::{PHONE, REMOTE};
use crate::codec::{self, Codec};
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::robots::instruments::counted;
use crate::robots::{
    Alarm, Axis, Cycle, Figure, Instruments, Intake, Need, Overlay, Panel, PanelRow, ScanDecoder,
    Station,
};
use crate::scenario::DeviceSpec;

const INTAKES: [Intake; 3] = [
    Intake::new("car", |rig| {
        counted(rig, &["board frames"], &["board bad frames"])
    }),
    Intake::new("odometer", |rig| {
        counted(rig, &["odometer lines"], &["odometer bad lines"])
    }),
    Intake::new(REMOTE, |rig| {
        counted(rig, &["remote packets", "remote bad packets"], &[])
    }),
];

const COMPLAINTS: [Alarm; 4] = [
    Alarm::new("car", "board bad frames"),
    Alarm::new("odometer", "odometer bad lines"),
    Alarm::new("scan", "messages without meaning"),
    Alarm::new(REMOTE, "remote bad packets"),
];

const CYCLES: [Cycle; 1] = [
    // A pair each 20 ms.
    Cycle::new(
        "car",
        "pair of commands",
        Duration::from_millis(200),
        |_| true,
    )
    .at_most(150),
];

/// The ranges that the program uses, in the order of the board's frame.
const RANGES: [&str; 3] = [
    "the range ahead, m",
    "the range to the right, m",
    "the range to the left, m",
];
/// Maximum difference of a range: noise.
const RANGE_M: f64 = 0.05;
/// Maximum difference of the battery's voltage.
const VOLTAGE_MV: f64 = 200.0;
/// Interval at which the program's values are compared with those of the board, and the number of
/// wrong ones in a row that fail: 2 s.
const COMPARED: Duration = Duration::from_millis(250);
const LASTING: u32 = 8;

/// The robot's instruments.
#[derive(Clone, Debug)]
pub(super) struct ApolloInstruments {
    camera: DeviceSpec,
    follows_wall: bool,
}

impl ApolloInstruments {
    /// Instruments for a car with this camera mounting. A car that follows a wall uses the sensors
    /// of its board.
    pub(super) const fn new(camera: DeviceSpec, follows_wall: bool) -> Self {
        Self {
            camera,
            follows_wall,
        }
    }
}

fn board(rig: &Rig) -> Option<&CarBoard> {
    rig.device("car")
}

fn program(rig: &Rig) -> Option<&Apollo13> {
    rig.program_as()
}

impl Instruments for ApolloInstruments {
    /// The commands that the board accepted: a motor level, and a steering value. The actual
    /// steering value is the nearest one to the angle of the wheels.
    fn axes(&self, rig: &Rig) -> Vec<Axis> {
        let Some(board) = board(rig) else {
            return Vec::new();
        };
        let actuators = rig.world.actuators();
        let place = actuators.iter().position(|it| it.name == "steering");
        let angle = place.map(|index| rig.world.chassis().actual(index).to_degrees());
        let value = angle.and_then(steering::nearest).map(|it| it.get().into());
        let [level_max, steering_max] = [Level::RANGE[1], Steering::RANGE[1]].map(f64::from);
        vec![
            Axis {
                name: "motor level".into(),
                unit: "",
                set_point: board.level().get().into(),
                limit: Some(level_max),
                actual: None,
            },
            Axis {
                name: "steering".into(),
                unit: "",
                set_point: board.steering().map_or(0.0, |value| value.get().into()),
                limit: Some(steering_max),
                actual: value,
            },
        ]
    }

    fn panels(&self, rig: &Rig) -> Vec<Panel> {
        let panels = [
            ("board", program(rig).map_or(Vec::new(), board_rows)),
            ("planner", program(rig).map_or(Vec::new(), planner_rows)),
            ("phone", phone_rows(rig)),
        ];
        let panels = panels.into_iter().filter(|(_, rows)| !rows.is_empty());
        let panel = |(name, rows): (&str, Vec<PanelRow>)| Panel {
            name: name.to_owned(),
            rows,
        };
        panels.map(panel).collect()
    }

    fn overlays(&self, rig: &Rig) -> Vec<Overlay> {
        program(rig).map_or(Vec::new(), overlays::of)
    }

    fn station<'a>(&'a self, rig: &'a Rig) -> Option<&'a dyn Station> {
        let phone = rig.device::<Phone>(PHONE)?;
        Some(phone)
    }

    fn station_mut<'a>(&'a self, rig: &'a mut Rig) -> Option<&'a mut dyn Station> {
        let phone = rig.device_to_plan::<Phone>(PHONE)?;
        Some(phone)
    }

    fn scanner(&self, _: &Rig) -> Option<(String, Box<dyn ScanDecoder>)> {
        Some(("scan".to_owned(), self.camera.scanner()?))
    }

    /// Markers are only seen occasionally.
    fn sporadic_links(&self) -> &'static [&'static str] {
        &["markers"]
    }

    /// Driven by hand: the phone. Along a wall: the board. Otherwise: the front camera.
    fn needs(&self) -> Vec<Need> {
        let remote = Need::always(REMOTE).only(&["remote"]);
        let scan = Need::always("scan");
        match self.follows_wall {
            true => vec![
                remote,
                Need::always("car").only(&["autonomous", "board silent"]),
                scan.only(&["gates", "mapping", "camera silent"]),
            ],
            false => vec![
                remote,
                scan.only(&["autonomous", "gates", "mapping", "camera silent"]),
            ],
        }
    }

    fn drive_links(&self) -> Vec<String> {
        vec!["car".to_owned()]
    }

    fn orders_link(&self) -> Option<&'static str> {
        Some(REMOTE)
    }

    fn station_links(&self) -> &'static [&'static str] {
        &[REMOTE]
    }

    /// Nearer than 0.45 m the camera measures nothing, and the car uses its ultrasound.
    fn blind_below_m(&self) -> Option<f64> {
        Some(0.6)
    }

    fn intakes(&self) -> &'static [Intake] {
        &INTAKES
    }

    /// In generated halls the error is 70 mm at most.
    fn accuracy(&self) -> Option<[f64; 2]> {
        Some([250.0, 20.0])
    }

    fn complaints(&self) -> &'static [Alarm] {
        &COMPLAINTS
    }

    fn cycles(&self) -> &'static [Cycle] {
        &CYCLES
    }

    fn reckoned(&self, rig: &Rig) -> Option<(Instant, Pose)> {
        let pose = program(rig)?.reckoned();
        Some((rig.now(), Pose::new(pose.x_m, pose.y_m, pose.heading_rad)))
    }

    /// The ranges and the voltage that the program uses, with those that the board sent last.
    fn figures(&self, rig: &Rig) -> Vec<Figure> {
        let frame = board(rig).and_then(CarBoard::last_frame);
        let (Some(program), Some(frame)) = (program(rig), frame) else {
            return Vec::new();
        };
        let sent = frame.readings();
        let words = [sent.front_cm, sent.right_cm, sent.left_cm];
        let millis = u64::try_from(COMPARED.as_millis()).unwrap_or(1);
        let now = rig.now().as_millis() / millis * millis;
        let figure = |name, told, truth, tolerance| Figure {
            name,
            at: Instant::from_millis(now),
            told,
            truth,
            tolerance,
            wrong_min: LASTING,
        };
        let ranges = RANGES.into_iter().zip(program.ultrasound_m()).zip(words);
        // 0: nothing new.
        let ranges = ranges.filter(|(_, word)| *word > 0);
        let mut figures: Vec<Figure> = ranges
            .filter_map(|((name, told), word)| {
                Some(figure(name, told?, f64::from(word) / 100.0, RANGE_M))
            })
            .collect();
        let told = program.battery_mv();
        if told > 0 {
            let truth = f64::from(sent.battery_mv);
            let name = "the voltage of the battery, mV";
            figures.push(figure(name, told.into(), truth, VOLTAGE_MV));
        }
        figures
    }

    fn codec(&self, _: &Rig, link: &str) -> Option<&'static Codec> {
        match link {
            "car" => Some(&codec::CAR_BOARD),
            "odometer" => Some(&codec::ODOMETER),
            "scan" | "markers" => Some(&codec::PERCEPTION),
            REMOTE | PHONE => Some(&codec::OSC),
            _ => None,
        }
    }

    /// Commands to the board and reports from it have different frames.
    fn codec_towards(&self, rig: &Rig, link: &str, direction: Direction) -> Option<&'static Codec> {
        match (link, direction) {
            ("car", Direction::ToDevice) => Some(&codec::CAR_COMMAND),
            _ => self.codec(rig, link),
        }
    }
}

fn row(name: &'static str, value: impl ToString, unit: &'static str) -> PanelRow {
    PanelRow {
        name: name.into(),
        address: None,
        value: value.to_string(),
        unit: unit.into(),
    }
}

/// The board's reports that the program received.
fn board_rows(program: &Apollo13) -> Vec<PanelRow> {
    let names = ["ultrasound ahead", "ultrasound right", "ultrasound left"];
    let ranges = names.into_iter().zip(program.ultrasound_m());
    let shown = |range: Option<f64>| range.map_or_else(|| "-".to_owned(), |m| format!("{m:.2}"));
    let ranges = ranges.map(|(name, range)| row(name, shown(range), "m"));
    let battery = format!("{:.2}", f64::from(program.battery_mv()) / 1e3);
    ranges.chain([row("battery", battery, "V")]).collect()
}

fn planner_rows(program: &Apollo13) -> Vec<PanelRow> {
    let pilot = program.pilot();
    let goal = pilot.goal().map_or_else(
        || "-".to_owned(),
        |goal| format!("{:.2}, {:.2}", goal.x_m, goal.y_m),
    );
    let gates = program.gates();
    vec![
        row("goal", goal, "m"),
        row("goal state", format!("{:?}", pilot.state()), ""),
        row("plans", pilot.plans(), ""),
        row("way", pilot.path().len(), "poses"),
        row("particles", program.particles().len(), ""),
        row("markers", gates.markers().count(), ""),
        row("gates passed", gates.passed().len(), ""),
        row("gates blocked", gates.blocked(), ""),
    ]
}

fn phone_rows(rig: &Rig) -> Vec<PanelRow> {
    let Some(phone) = rig.device::<Phone>(PHONE) else {
        return Vec::new();
    };
    let (goals, next) = phone.goals();
    vec![
        row("goals", goals.len(), ""),
        row("goals reached", next.min(goals.len()), ""),
    ]
}
