//! The lidar's stream, the odometer, and the wire to the PC.

use core::time::Duration;
use std::sync::{Arc, Mutex};

use emulators::world::{BodyConfig, Drive, Fixture, Point, Pose, Scene, Shape, Wheel, World};
use emulators::xv11::{Config, Xv11};
use engine::rig::Rig;
use engine::rig::line::{Direction, End};
use engine::rig::trace::{Side, Tap};
use firmware_core::grid::Grid;
use protocols::xv11::{self, Reading};
use protocols::{Decode as _, Instant, LineConfig, Port};

use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_seed};
use crate::experiment::runs::{FLAT, Spread, start};

/// Pages 7 and 8: the lidar's stream.
pub(in super::super) const LIDAR: Measure = Measure {
    name: "lidar",
    planted: "a motor that turns a tenth slower",
    perform: lidar,
};

/// A hall around the robot's map: its walls are 5.2 m away, its corners 7.4 m.
const HALL: &str = "schema = 1\nname = \"hall\"\nrobot = \"rescue\"\nduration = \"12s\"\n\
    [world]\nstart = { x_m = 1.5, y_m = 1.5, heading_deg = 90 }\n[[world.wall]]\n\
    path_m = [[-3.7, -3.7], [6.7, -3.7], [6.7, 6.7], [-3.7, 6.7], [-3.7, -3.7]]\n";
/// Time at which the motor has its speed, and duration of the measurement.
const FROM: Duration = Duration::from_secs(4);
const SECONDS: u64 = 8;

/// Bytes of the lidar as they were sent, each with its time.
#[derive(Clone, Debug, Default)]
struct Sent(Arc<Mutex<Vec<(Instant, u8)>>>);

impl Tap for Sent {
    fn record(&mut self, link: usize, to: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if (link, to, side) == (0, Direction::ToMaster, Side::Sent)
            && let Ok(mut sent) = self.0.lock()
        {
            sent.extend(bytes.iter().map(|byte| (at, *byte)));
        }
    }
}

/// Turns a second, bytes and readings of a turn, and the longest distance, m.
fn lidar(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let found = by_seed(plan, tell, |seed| {
        let slow = "[device.lidar.xv11]\nsupply = { regulated-rpm = 270 }\n";
        let text = format!("{HALL}{}", model.pick("", slow));
        let mut run = start(&text, seed, |_| {});
        let lidar = run.rig.links().iter().position(|link| link.name == "lidar");
        let sent = Sent::default();
        run.rig
            .add_tap(Box::new(OfLink(lidar.unwrap_or(0), sent.clone())));
        run.go_on_until(Instant::ZERO + FROM + Duration::from_secs(SECONDS));
        let sent = sent.0.lock().map(|sent| sent.clone()).unwrap_or_default();
        let sent = sent.iter().filter(|(at, _)| *at >= Instant::ZERO + FROM);
        turns(sent)
    });
    let mut measured = Measured::default();
    let names = [
        "turns a second",
        "bytes of a turn",
        "directions of a turn",
        "longest distance (m)",
    ];
    for (index, name) in names.into_iter().enumerate() {
        measured.value(name, found.iter().map(|one| one[index]));
    }
    measured
}

/// A tap of one link.
struct OfLink(usize, Sent);

impl Tap for OfLink {
    fn record(&mut self, link: usize, to: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if link == self.0 {
            self.1.record(0, to, side, at, bytes);
        }
    }
}

/// Figures of the stream.
fn turns<'a>(sent: impl Iterator<Item = &'a (Instant, u8)>) -> [f64; 4] {
    let mut decoder = xv11::Decoder::default();
    let (mut starts, mut bytes, mut longest) = (Vec::new(), 0_u32, 0.0_f64);
    let mut bytes_at_start = Vec::new();
    let mut packets = Vec::new();
    let mut count = 0_u32;
    for (at, byte) in sent {
        bytes += 1;
        for frame in decoder.push(&[*byte]).flatten() {
            if frame.index() == 0 {
                starts.push(*at);
                bytes_at_start.push(f64::from(bytes));
                packets.push(f64::from(count));
                count = 0;
            }
            count += 1;
            for reading in frame.readings() {
                if let Reading::Range { distance_mm, .. } = reading {
                    longest = longest.max(f64::from(distance_mm) / 1_000.0);
                }
            }
        }
    }
    let periods = starts
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).as_secs_f64());
    let between = bytes_at_start.windows(2).map(|pair| pair[1] - pair[0]);
    [
        1.0 / Spread::of(periods).median,
        Spread::of(between).median,
        4.0 * Spread::of(packets.into_iter().skip(1)).median,
        longest,
    ]
}

/// Page 20: the time of a byte and of a map on the wire.
pub(in super::super) const BYTES: Measure = Measure {
    name: "bytes",
    planted: "a line without start and stop bits",
    perform: bytes,
};

/// Rate of the module, and cells of the map.
const BAUD: u32 = 460_800;
const CELLS: usize = 90_000;

fn bytes(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let times = by_seed(plan, tell, |_| {
        // Eight bits instead of ten.
        let line = LineConfig::new_8n1(model.pick(BAUD, BAUD / 8 * 10));
        let scene = Scene::new(Vec::<Fixture>::new(), Vec::new()).expect("nothing is fine");
        let world = World::new(scene, BodyConfig::default(), Pose::default(), 1);
        let mut rig = Rig::new(world.expect("nothing is near"));
        let [from, to] = ["from", "to"].map(|name| rig.add_outside(name, line));
        let end = |node| End {
            node,
            port: Port(0),
        };
        rig.connect("wire", end(from), end(to), 64);
        rig.inject(from, &[127; CELLS]);
        let mut arrived = 0;
        while arrived < CELLS {
            let Some(next) = rig.next_event() else {
                return f64::NAN;
            };
            rig.run_until(next);
            arrived += rig.take_output(to).len();
        }
        (rig.now() - Instant::ZERO).as_secs_f64()
    });
    let mut measured = Measured::default();
    let each = times.iter().map(|time| time * 1e6 / CELLS as f64);
    measured.value("time of a byte (us)", each);
    measured.value("time of the map (s)", times);
    measured
}

/// Page 14: ticks of the odometer.
pub(in super::super) const ODOMETER: Measure = Measure {
    name: "odometer",
    planted: "wheels a tenth larger",
    perform: odometer,
};

/// Radius of the robot's wheels, metres.
const WHEEL_M: f64 = 0.026;

fn odometer(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let larger = model.pick("", "\n[world.body]\nwheel_radius_m = 0.0286\n");
    let ticks = by_seed(plan, tell, |seed| {
        let mut run = start(&format!("{FLAT}{larger}"), seed, |_| {});
        let mut at = |tenths: u64| {
            run.go_on_until(Instant::from_millis(100 * tenths));
            let ticks = Wheel::ALL.map(|wheel| run.rig.world.encoder_ticks(wheel) as f64);
            (f64::midpoint(ticks[0], ticks[1]), run.rig.world.pose())
        };
        // Parts of the drive in which the robot moves forwards.
        let looks: Vec<(f64, Pose)> = (20..150).map(&mut at).collect();
        let (mut ticks, mut far_m) = (0.0, 0.0_f64);
        for pair in looks.windows(2) {
            let step_m = pair[0].1.point().distance(pair[1].1.point());
            if pair[1].0 - pair[0].0 > 20.0 {
                ticks += pair[1].0 - pair[0].0;
                far_m += step_m;
            }
        }
        ticks / (far_m / (core::f64::consts::TAU * WHEEL_M))
    });
    let mut measured = Measured::default();
    measured.value("ticks of a turn of the wheel", ticks);
    measured
}

/// Page 7: the lidar's minimum range.
pub(in super::super) const RANGE: Measure = Measure {
    name: "range",
    planted: "a lidar whose distances are a tenth too long",
    perform: range,
};

/// A wall 0.1 m beside the lidar: its beams meet it at all distances from 0.1 m on.
fn range(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let factor = model.pick(1.0, 1.1);
    let nearest = by_seed(plan, tell, |seed| {
        let wall = Shape::Wall {
            from: Point::new(0.1, -3.0),
            to: Point::new(0.1, 3.0),
        };
        let body = BodyConfig {
            radius_m: 0.05,
            ..BodyConfig::default().ideal()
        };
        let scene = Scene::new([wall], Vec::new()).expect("one wall");
        let world = World::new(scene, body, Pose::default(), seed).expect("room enough");
        let frames = lidar_frames(world, seed, 3, |_| {});
        let ranges = frames.iter().flat_map(|frame| frame.readings());
        let ranges = ranges.filter_map(|reading| match reading {
            Reading::Range { distance_mm, .. } => Some(f64::from(distance_mm) * factor / 10.0),
            Reading::Invalid { .. } => None,
        });
        ranges.fold(f64::NAN, f64::min)
    });
    let mut measured = Measured::default();
    measured.value("shortest distance (cm)", nearest);
    measured
}

/// Frames of a second of a lidar in this world, once its motor has its speed. `act` acts on the
/// world a second earlier.
fn lidar_frames(
    world: World,
    seed: u64,
    from_s: u64,
    act: impl FnOnce(&mut World),
) -> Vec<xv11::Frame> {
    let mut rig = Rig::new(world);
    let lidar = rig.add_device("lidar", Xv11::new("lidar", seed, Config::default()));
    let node = rig.add_outside("program", LineConfig::new_8n1(xv11::BAUD));
    let end = |node, port| End { node, port };
    rig.connect("lidar", end(lidar, Xv11::UART), end(node, Port(0)), 22);
    rig.run_for(Duration::from_secs(from_s));
    act(&mut rig.world);
    rig.run_for(Duration::from_secs(1));
    rig.take_output(node);
    rig.run_for(Duration::from_secs(1));
    let mut decoder = xv11::Decoder::default();
    let bytes = rig.take_output(node);
    decoder.push(&bytes).flatten().collect()
}

/// Page 13: the smear of a scan.
pub(in super::super) const SMEAR: Measure = Measure {
    name: "smear",
    planted: "a robot that drives at 0.27 m/s",
    perform: smear,
};

/// A beam to the right meets a wall at 45 degrees. Each millimetre forwards lengthens the beam by a
/// millimetre.
fn smear(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let steps = by_seed(plan, tell, |seed| {
        let wall = Shape::Wall {
            from: Point::new(0.1, -0.2),
            to: Point::new(2.3, 2.0),
        };
        let body = BodyConfig {
            full_speed_m_s: model.pick(0.3, 0.27),
            ..BodyConfig::default().ideal()
        };
        let scene = Scene::new([wall], Vec::new()).expect("one wall");
        let start = Pose::new(0.0, 0.0, core::f64::consts::FRAC_PI_2);
        let world = World::new(scene, body, start, seed).expect("room enough");
        let frames = lidar_frames(world, seed, 3, |world| {
            for wheel in Wheel::ALL {
                world.set_drive(wheel, Drive::Power(255));
            }
        });
        let firsts = frames.iter().filter(|frame| frame.index() == 0);
        let ranges = firsts.filter_map(|frame| match frame.readings()[0] {
            Reading::Range { distance_mm, .. } => Some(f64::from(distance_mm)),
            Reading::Invalid { .. } => None,
        });
        let ranges: Vec<f64> = ranges.collect();
        Spread::of(ranges.windows(2).map(|pair| pair[1] - pair[0])).median
    });
    let mut measured = Measured::default();
    measured.value("motion during a turn (mm)", steps);
    measured
}

/// Page 22: the largest square map in 8 MB.
pub(in super::super) const LARGE: Measure = Measure {
    name: "large",
    planted: "cells of two bytes",
    perform: large,
};

/// Memory of the larger board, bytes, and edge of a cell, metres.
const MEMORY: usize = 8_000_000;
const CELL_M: f64 = 0.01;

fn large(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let sides = by_seed(plan, tell, |_| {
        // Memory of a cell and of the rest of a map, by the sizes of two maps of the program.
        let (one, other) = (size_of::<Grid<300, 300>>(), size_of::<Grid<600, 600>>());
        let cell = (other - one) / (600 * 600 - 300 * 300) * model.pick(1, 2);
        let rest = one.saturating_sub(cell * 300 * 300);
        ((MEMORY - rest) / cell).isqrt() as f64
    });
    let mut measured = Measured::default();
    let edges = sides.iter().map(|cells| cells * CELL_M);
    measured.value("edge of the map (m)", edges);
    measured.value("cells along an edge", sides);
    measured
}
