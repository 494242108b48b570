//! The lidar's stream, and the transfer of the map to the PC.

use core::time::Duration;
use std::sync::{Arc, Mutex};

use emulators::hc06::{Hc06, Profile};
use emulators::pc::Pc;
use emulators::world::{BodyConfig, Drive, Fixture, Point, Pose, Scene, Shape, Wheel, World};
use emulators::xv11::{Config, Xv11};
use engine::rig::Rig;
use engine::rig::line::{Direction, End};
use engine::rig::trace::{Side, Tap};
use engine::scenario::MapperSpec;
use firmware_core::Inspect as _;
use firmware_core::robots::rescue::Rescue;
use protocols::pcui::message::encode_row;
use protocols::pcui::{Decoder as Rows, FRAME_MAX};
use protocols::rle::Dialect;
use protocols::xv11::{self, Reading};
use protocols::{Decode as _, Instant, LineConfig, LineEvent, Port};

use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_case, by_seed};
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

/// Page 8: the radio module's rates.
pub(in super::super) const RADIO: Measure = Measure {
    name: "radio",
    planted: "a module with a buffer of 2500 bytes in place of 700",
    perform: radio,
};

/// Rates of the module.
const BAUDS: [u32; 10] = [
    19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 576_000, 691_200, 921_600, 1_382_400,
];
/// The robot sends while its mapper leaves the processor free: 50 of 200 ms (page 16).
const CYCLE_MS: u32 = 200;
const FREE_MS: u32 = 50;
/// The transmit queue of the published program, bytes.
const QUEUE: u32 = 1_500;
/// Time after which the transfer of a map is aborted.
const GIVEN_UP_S: f64 = 60.0;

fn radio(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let rows = coded_rows();
    let sent = by_case(plan, tell, &BAUDS, |baud, seed| {
        map_by(&rows, baud, seed, model)
    });
    let mut measured = Measured::default();
    let at = |baud: u32| BAUDS.iter().position(|one| *one == baud).unwrap_or(0);
    let time = |baud: u32, seed: usize| sent[at(baud)][seed][0];
    let best = |seed: usize| {
        BAUDS
            .iter()
            .map(|baud| time(*baud, seed))
            .fold(GIVEN_UP_S, f64::min)
    };
    let seeds = 0..plan.count();
    let ratio = |seed: usize| time(460_800, seed) / best(seed);
    measured.value(
        "time of a map at 460800 against the best rate",
        seeds.clone().map(ratio),
    );
    let slower = |seed: usize| time(115_200, seed) / time(460_800, seed);
    measured.value(
        "time of a map at 115200 against 460800",
        seeds.clone().map(slower),
    );
    let more = |seed: usize| sent[at(1_382_400)][seed][1] - sent[at(460_800)][seed][1];
    measured.value(
        "rows lost at 1382400 more than at 460800 (%)",
        seeds.map(more),
    );
    let curve = |index: usize| {
        let places = BAUDS.iter().zip(&sent);
        places.map(move |(baud, runs)| {
            let values = runs.iter().map(|one| one[index]);
            [f64::from(*baud), Spread::of(values).median]
        })
    };
    measured.curve("time until the whole map is there (s)", curve(0));
    measured.curve("rows lost (%)", curve(1));
    measured
}

/// The rows of a map of the flat, run-length coded where that is shorter, as frames.
fn coded_rows() -> Vec<Vec<u8>> {
    let mut run = start(FLAT, 1, |scenario| {
        scenario.program.mapper = MapperSpec::Document
    });
    run.go_on_until(Instant::from_secs(30));
    let program = run.rig.program_as::<Rescue>();
    let map = program.and_then(Rescue::map).expect("the robot has one");
    let frame = |(y, row): (u16, &[u8])| {
        let mut frame = [0; FRAME_MAX];
        let len = encode_row(0, y, row, Dialect::Lossless, &mut frame).unwrap_or(0);
        frame[..len].to_vec()
    };
    (0..).zip(map.rows()).map(frame).collect()
}

/// Sends the map's rows again and again until all have arrived: the time, s, and the share of lost
/// rows, %.
fn map_by(rows: &[Vec<u8>], baud: u32, seed: u64, model: Model) -> [f64; 2] {
    let line = LineConfig::new_8n1(baud);
    let profile = Profile::default().at_baud(baud);
    let profile = match model {
        Model::Sound => profile,
        Model::Planted => Profile {
            fifo_len: 2_500,
            ..profile
        },
    };
    let (mut rig, robot, host) = radio_bench(Hc06::new(profile, seed), line);
    rig.run_for(Duration::from_secs(5));
    let begun = rig.now();
    let mut decoder = Rows::default();
    let mut there = [false; 300];
    let (mut queued, mut y, mut sent, mut good) = (0.0_f64, 0, 0_u32, 0_u32);
    let per_ms = 0.001 / line.byte_time().as_secs_f64();
    for ms in 0.. {
        queued = (queued - per_ms).max(0.0);
        let is_free = ms % CYCLE_MS < FREE_MS;
        while is_free && queued + rows[y].len() as f64 <= f64::from(QUEUE) {
            rig.inject(robot, &rows[y]);
            queued += rows[y].len() as f64;
            y = (y + 1) % rows.len();
            sent += 1;
        }
        rig.run_for(Duration::from_millis(1));
        let bytes = rig.take_output(host);
        for frame in decoder.push(&bytes).flatten() {
            // The row's number follows the layer.
            if let [_, low, high, ..] = *frame.payload() {
                let y = usize::from(u16::from_le_bytes([low, high]));
                there.get_mut(y).into_iter().for_each(|row| *row = true);
                good += 1;
            }
        }
        let time = (rig.now() - begun).as_secs_f64();
        if there.iter().all(|row| *row) || time >= GIVEN_UP_S {
            // Rows that are still in the queue are not lost.
            let under_way = queued / rows.iter().map(Vec::len).sum::<usize>() as f64 * 300.0;
            let lost = 1.0 - f64::from(good) / (f64::from(sent) - under_way).max(1.0);
            return [time, 100.0 * lost.max(0.0)];
        }
    }
    unreachable!("the loop ends by its time")
}

/// A module between a robot and a connected host.
fn radio_bench(module: Hc06, line: LineConfig) -> (Rig, usize, usize) {
    let scene = Scene::new(Vec::<Fixture>::new(), Vec::new()).expect("nothing is fine");
    let world = World::new(scene, BodyConfig::default(), Pose::default(), 1);
    let mut rig = Rig::new(world.expect("nothing is near"));
    let module = rig.add_device("radio", module);
    let robot = rig.add_outside("robot", line);
    let host = rig.add_outside("pc", emulators::hc06::AIR_LINE);
    let end = |node, port| End { node, port };
    rig.connect("uart", end(module, Hc06::UART), end(robot, Port(0)), 64);
    rig.connect("air", end(module, Hc06::AIR), end(host, Port(0)), 64);
    rig.change_line(host, LineEvent::Opened);
    (rig, robot, host)
}

/// Figure 12: the map on the PC.
pub(in super::super) const TRANSFER: Measure = Measure {
    name: "transfer",
    planted: "a radio of 2 kB/s",
    perform: transfer,
};

fn transfer(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let times = by_seed(plan, tell, |seed| {
        let slow = "\n[device.radio.hc06]\nrate_bytes_s = 2000\n";
        let text = format!("{FLAT}{}", model.pick("", slow));
        let mut run = start(&text, seed, |scenario| scenario.mission.to_the_end = true);
        let mut first = None;
        while !run.is_over() {
            run.step();
            let Some(pc) = run.rig.device::<Pc>("pc") else {
                break;
            };
            if first.is_none() && pc.map().is_some() {
                first = Some(run.rig.now());
            }
            if let Some((first, at)) = first.zip(pc.map_complete_at()) {
                return (at - first).as_secs_f64();
            }
        }
        f64::NAN
    });
    let mut measured = Measured::default();
    measured.value("time until the whole map is there (s)", times);
    measured
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
        let mut rig = Rig::new(World::new(scene, body, start, seed).expect("room enough"));
        let lidar = rig.add_device("lidar", Xv11::new("lidar", seed, Config::default()));
        let node = rig.add_outside("program", LineConfig::new_8n1(xv11::BAUD));
        let end = |node, port| End { node, port };
        rig.connect("lidar", end(lidar, Xv11::UART), end(node, Port(0)), 22);
        rig.run_for(Duration::from_secs(3));
        for wheel in Wheel::ALL {
            rig.world.set_drive(wheel, Drive::Power(255));
        }
        rig.run_for(Duration::from_secs(1));
        rig.take_output(node);
        rig.run_for(Duration::from_secs(1));
        let mut decoder = xv11::Decoder::default();
        let bytes = rig.take_output(node);
        let frames = decoder.push(&bytes).flatten();
        let firsts = frames.filter(|frame| frame.index() == 0);
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
