//! The interface of the robot.

use core::time::Duration;

use emulators::wheel_board::WheelBoard;
use emulators::world::{Pose, Wheel};
use firmware_core::Inspect as _;
use firmware_core::map_view::MapView;
use firmware_core::robots::yellow::Yellow;
use firmware_core::robots::yellow::pc::PcProgram;
use protocols::Instant;
use protocols::telemetry::message::{self, State};

use super::overlays;
use super::script::WHEEL_MAX_M_S;
use super::station::PcStation;
use super::{BOARD, PC, TELEMETRY, command};
use crate::codec::{self, Codec};
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::robots::instruments::{counted, in_metres};
use crate::robots::{
    Alarm, Axis, Cycle, Dialect, Figure, Instruments, Intake, Need, Overlay, Panel, PanelRow,
    ScanDecoder, Station,
};
use crate::scenario::DeviceSpec;

const INTAKES: [Intake; 4] = [
    Intake::new(BOARD, |rig| {
        counted(rig, &["board samples"], &["board samples bad"])
    }),
    Intake::new("lidar", |rig| {
        counted(rig, &["lidar nodes"], &["lidar groups bad"])
    }),
    Intake::new(TELEMETRY, |rig| {
        let accepted = ["telecommands", "radio bad messages", "radio echoes"];
        counted(rig, &accepted, &["radio bad frames"])
    }),
    Intake {
        direction: Direction::ToDevice,
        may_ignore: true,
        ..Intake::new(TELEMETRY, |rig| {
            let mut counts = [0; 2];
            pc(rig)?.counters(&mut |name, value| match name {
                "frames" => counts[0] += value,
                "bad frames" => counts[1] += value,
                _ => {}
            });
            Some(counts)
        })
    },
];

const COMPLAINTS: [Alarm; 7] = [
    Alarm::new(BOARD, "board samples bad"),
    Alarm::new(BOARD, "encoder samples disbelieved"),
    Alarm::new(BOARD, "manoeuvres interrupted"),
    Alarm::new("lidar", "lidar groups bad"),
    Alarm::new("lidar", "lidar silences"),
    Alarm::new(TELEMETRY, "radio bad frames"),
    Alarm::new(TELEMETRY, "radio bad messages"),
];

/// The program answers each sample of a millisecond, and sends telemetry each 200 ms.
const CYCLES: [Cycle; 2] = [
    Cycle::new(BOARD, "outputs", Duration::from_millis(100), |_| true),
    Cycle::new(TELEMETRY, "telemetry", Duration::from_millis(800), |_| true)
        .at_most(12)
        .dated(),
];

/// The robot's instruments.
#[derive(Clone, Debug)]
pub(super) struct YellowInstruments {
    lidar: Option<DeviceSpec>,
}

impl YellowInstruments {
    /// Instruments for a robot with this lidar mounting.
    pub(super) const fn new(lidar: Option<DeviceSpec>) -> Self {
        Self { lidar }
    }
}

fn station(rig: &Rig) -> Option<&PcStation> {
    rig.device(PC)
}

fn pc(rig: &Rig) -> Option<&PcProgram> {
    station(rig).map(PcStation::program)
}

fn board(rig: &Rig) -> Option<&WheelBoard> {
    rig.device(BOARD)
}

impl Instruments for YellowInstruments {
    /// Speeds of the wheel rims for the current duties, by the nominal values of the motors.
    fn axes(&self, rig: &Rig) -> Vec<Axis> {
        let Some(board) = board(rig) else {
            return Vec::new();
        };
        let wheels = Wheel::ALL.into_iter().zip(board.set_points());
        let axis = |(wheel, set_point)| Axis {
            name: match wheel {
                Wheel::Left => "left wheel".into(),
                Wheel::Right => "right wheel".into(),
            },
            unit: "m/s",
            set_point,
            limit: Some(LIMIT_M_S),
            actual: Some(rig.world.wheel_speed(wheel)),
        };
        wheels.map(axis).collect()
    }

    fn dialect(&self, rig: &Rig) -> Option<Dialect> {
        command::dialect(board(rig)?)
    }

    /// The pose of a program in this process; otherwise the pose reported to the PC.
    fn estimate(&self, rig: &Rig) -> Option<(Instant, Pose)> {
        if let Some(program) = rig.program() {
            let (at, pose) = program.estimate()?;
            return Some((at, in_metres(pose)));
        }
        let pc = pc(rig)?;
        let (at, _) = pc.telemetry()?;
        Some((at, in_metres(pc.believed_pose()?)))
    }

    /// The PC builds the map.
    fn map<'a>(&'a self, rig: &'a Rig) -> Option<MapView<'a>> {
        pc(rig)?.global_map()
    }

    fn layers<'a>(&'a self, rig: &'a Rig) -> Vec<(&'static str, MapView<'a>)> {
        let local = pc(rig).and_then(PcProgram::local_map);
        local.map(|map| ("local", map)).into_iter().collect()
    }

    fn overlays(&self, rig: &Rig) -> Vec<Overlay> {
        let program = rig.program_as::<Yellow>();
        let infrared =
            program.map(|program| overlays::infrared(program, in_metres(program.pose())));
        let known = pc(rig).into_iter().flat_map(overlays::of_pc);
        let all = infrared.into_iter().chain(known);
        all.filter(|overlay| !overlay.is_empty()).collect()
    }

    fn scanner(&self, _: &Rig) -> Option<(String, Box<dyn ScanDecoder>)> {
        let decoder = self.lidar.as_ref()?.scanner()?;
        Some(("lidar".to_owned(), decoder))
    }

    fn panels(&self, rig: &Rig) -> Vec<Panel> {
        let panels = [
            ("board", board_rows(rig)),
            ("infrared", infrared_rows(rig)),
            ("pc", pc_rows(rig)),
        ];
        let panels = panels.into_iter().filter(|(_, rows)| !rows.is_empty());
        let panel = |(name, rows): (&str, Vec<PanelRow>)| Panel {
            name: name.to_owned(),
            rows,
        };
        panels.map(panel).collect()
    }

    fn station<'a>(&'a self, rig: &'a Rig) -> Option<&'a dyn Station> {
        station(rig).map(|pc| pc as &dyn Station)
    }

    fn station_mut<'a>(&'a self, rig: &'a mut Rig) -> Option<&'a mut dyn Station> {
        let pc = rig.device_to_plan::<PcStation>(PC)?;
        Some(pc)
    }

    /// The PC, if driven by hand; its silence ends that after 2 s, as the fielded program declares.
    fn needs(&self) -> Vec<Need> {
        vec![Need {
            stops_after: Duration::from_secs(2),
            ..Need::always(TELEMETRY).only(&["manual"])
        }]
    }

    fn drive_links(&self) -> Vec<String> {
        vec![BOARD.to_owned()]
    }

    fn orders_link(&self) -> Option<&'static str> {
        Some(TELEMETRY)
    }

    /// The duty of the lidar's motor is sent when it changes.
    fn sporadic_links(&self) -> &'static [&'static str] {
        &["lidar-motor"]
    }

    fn station_links(&self) -> &'static [&'static str] {
        &[TELEMETRY]
    }

    fn alarms(&self) -> &'static [Alarm] {
        &[Alarm {
            link: "lidar",
            counter: "lidar silences",
        }]
    }

    fn intakes(&self) -> &'static [Intake] {
        &INTAKES
    }

    fn complaints(&self) -> &'static [Alarm] {
        &COMPLAINTS
    }

    fn cycles(&self) -> &'static [Cycle] {
        &CYCLES
    }

    fn reckoned(&self, rig: &Rig) -> Option<(Instant, Pose)> {
        let (at, pose) = rig.program_as::<Yellow>()?.estimate()?;
        Some((at, in_metres(pose)))
    }

    fn reckoned_anew(&self, rig: &Rig) -> u64 {
        let program = rig.program_as::<Yellow>();
        program.map_or(0, |program| program.corrections().into())
    }

    fn goal_modes(&self) -> &'static [&'static str] {
        &["position"]
    }

    fn goal_bearing(&self, rig: &Rig) -> Option<f64> {
        rig.program_as::<Yellow>()?.goal_bearing().map(f64::from)
    }

    fn told_lines(&self, rig: &Rig) -> Option<(Instant, Vec<[[f64; 2]; 2]>)> {
        let (at, told) = pc(rig)?.telemetry()?;
        let end = |pose: message::Pose| [pose.x, pose.y].map(f64::from);
        let lines = told.lines.as_ref()?.iter();
        Some((
            at,
            lines.map(|line| [line.start, line.end].map(end)).collect(),
        ))
    }

    fn searched_points(&self, rig: &Rig) -> Vec<[f64; 2]> {
        let program = rig.program_as::<Yellow>();
        let points = program.map_or(&[][..], |program| program.scan()).iter();
        points
            .map(|point| [point.x_mm, point.y_mm].map(f64::from))
            .collect()
    }

    /// The reported pose and state with those of the program, the reported ranges with those of
    /// the board's sensors.
    fn figures(&self, rig: &Rig) -> Vec<Figure> {
        let mut figures = Vec::new();
        let Some((at, told)) = pc(rig).and_then(PcProgram::telemetry) else {
            return figures;
        };
        let own = rig.program().and_then(|program| program.estimate());
        if let (Some(odometry), Some((_, own))) = (&told.odometry, own) {
            let [x, y, heading] =
                [odometry.pose.x, odometry.pose.y, odometry.pose.alpha].map(f64::from);
            figures.extend(Figure::of_pose(
                at,
                Pose::new(x, y, heading),
                in_metres(own),
            ));
        }
        let program = rig.program_as::<Yellow>();
        if let (Some(state), Some(program)) = (told.state, program) {
            let own = program.mode().told();
            figures.push(Figure::of_mode(at, state as u8, own as u8));
        }
        if let (Some(infrared), Some(board)) = (&told.infrared, board(rig)) {
            let volts: Vec<f64> = board.range_volts().collect();
            let ranges = RANGES.iter().zip(&infrared.distances_m);
            figures.extend(ranges.filter_map(|(&(name, sensor), &told)| {
                Some(Figure {
                    name,
                    at,
                    told: told.into(),
                    truth: range_m(*volts.get(sensor)?),
                    tolerance: RANGE_M,
                    wrong_min: Figure::CHANGING,
                })
            }));
        }
        figures
    }

    fn codec(&self, _: &Rig, link: &str) -> Option<&'static Codec> {
        match link {
            "lidar" => Some(&codec::RPLIDAR),
            BOARD => Some(&codec::PERIPHERALS),
            TELEMETRY | PC => Some(&codec::TELEMETRY),
            _ => None,
        }
    }
}

/// The maximum duty is 0.98: 0.96 of 12 V and 40 rpm/V, with a margin for rounding.
const LIMIT_M_S: f64 = WHEEL_MAX_M_S + 0.02;

/// The reported ranges, with the numbers of their sensors: clockwise from ahead.
const RANGES: [(&str, usize); 3] = [
    ("the range ahead, m", 0),
    ("the range to the right front, m", 1),
    ("the range to the left front, m", 5),
];
/// Maximum difference of a reported range: noise of a far object.
const RANGE_M: f64 = 0.15;

/// The range at this voltage of a GP2Y0A21: 0.4 V or less are 0.8 m, 2.3 V are 0.1 m, and between
/// them the voltage is linear in the reciprocal of the range (data sheet).
fn range_m(volts: f64) -> f64 {
    let share = (volts - 0.4).max(0.0) / (2.3 - 0.4);
    1.0 / (1.0 / 0.8 + share * (1.0 / 0.1 - 1.0 / 0.8))
}

fn row(name: impl Into<String>, value: impl ToString, unit: &'static str) -> PanelRow {
    PanelRow {
        name: name.into().into(),
        address: None,
        value: value.to_string(),
        unit: unit.into(),
    }
}

fn board_rows(rig: &Rig) -> Vec<PanelRow> {
    let Some(board) = board(rig) else {
        return Vec::new();
    };
    let outputs = board.outputs();
    let drivers = if outputs.enable { "on" } else { "off" };
    let [left, right] = board.counters();
    let duty = |side: usize| format!("{:.2}", f64::from(outputs.duty[side]) / 100.0);
    let mut rows = vec![
        row("drivers", drivers, ""),
        row("duty left", duty(0), "%"),
        row("duty right", duty(1), "%"),
        row("counter left", left, ""),
        row("counter right", right, ""),
        row("battery", format!("{:.2}", board.supply_v()), "V"),
    ];
    let volts = board.range_volts().enumerate();
    rows.extend(volts.map(|(at, volts)| row(format!("IR {at}"), format!("{volts:.2}"), "V")));
    rows
}

/// The program's interpretation of its infrared sensors.
fn infrared_rows(rig: &Rig) -> Vec<PanelRow> {
    let program = rig.program_as::<Yellow>();
    let names = ["ahead", "right front", "left front"];
    let metres = program.map(Yellow::infrared_m).into_iter().flatten();
    let rows = names.into_iter().zip(metres);
    rows.map(|(name, metres)| row(name, format!("{metres:.3}"), "m"))
        .collect()
}

fn pc_rows(rig: &Rig) -> Vec<PanelRow> {
    let Some(station) = station(rig) else {
        return Vec::new();
    };
    let program = station.program();
    let (vertices, edges, way) = program.roadmap();
    let task = station.task_name().unwrap_or("none");
    let told = program.telemetry().and_then(|(_, told)| told.state);
    let mut rows = vec![
        row("state told", told.map_or("none", State::name), ""),
        row("task", task, ""),
        row("status", program.status(), ""),
        row("roadmap vertices", vertices.len(), ""),
        row("roadmap edges", edges.len(), ""),
        row("way", way.len(), "points"),
    ];
    program.counters(&mut |name, count| rows.push(row(name, count, "")));
    rows
}
