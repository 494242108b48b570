//! The radio module, and the transfer of the map to the PC.

use core::time::Duration;

use emulators::hc06::{Hc06, Profile};
use emulators::pc::Pc;
use emulators::world::{BodyConfig, Fixture, Pose, Scene, World};
use engine::rig::Rig;
use engine::rig::line::End;
use engine::scenario::TuningSpec;
use firmware_core::Inspect as _;
use firmware_core::robots::rescue::Rescue;
use protocols::pcui::message::{MapProperties, encode_map_properties, encode_row};
use protocols::pcui::{Decoder as Rows, FRAME_MAX};
use protocols::rle::Dialect;
use protocols::{Decode as _, Instant, LineConfig, LineEvent, Port};

use super::as_reported;
use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_case, by_seed};
use crate::experiment::runs::{FLAT, Spread, start};

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
/// The robot sends while its mapper leaves the processor free: 50 of 200 ms (page 16). The
/// published program's interrupt occupies the processor while a byte is on the wire, so its queue
/// stays empty and it stops in the middle of a row.
const CYCLE_MS: u32 = 200;
const FREE_MS: u32 = 50;
/// Period of the poses, which a task of higher priority writes at any time.
const POSE_MS: u32 = 50;
/// Time after which the transfer of a map is aborted.
const GIVEN_UP_S: f64 = 60.0;
/// Rows of the map.
const ROWS: usize = 300;
/// The rate of the report.
const REPORTED_BAUD: u32 = 460_800;

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
        as_reported(scenario, TuningSpec::default());
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

/// The published program as a sender of a map.
struct Sender<'a> {
    rows: &'a [Vec<u8>],
    /// Number of the current row, and its bytes that were sent.
    row: usize,
    sent: usize,
    /// Bytes that the line can still take.
    budget: f64,
}

impl Sender<'_> {
    /// Bytes of a millisecond at `per_ms` bytes.
    fn bytes(&mut self, ms: u32, per_ms: f64) -> Vec<u8> {
        let mut bytes = Vec::new();
        if ms.is_multiple_of(POSE_MS) {
            bytes.extend(pose());
        }
        if ms % CYCLE_MS >= FREE_MS {
            self.budget = 0.0;
            return bytes;
        }
        self.budget += per_ms - bytes.len() as f64;
        while self.budget >= 1.0 {
            bytes.push(self.rows[self.row][self.sent]);
            self.budget -= 1.0;
            self.sent += 1;
            if self.sent == self.rows[self.row].len() {
                (self.row, self.sent) = ((self.row + 1) % self.rows.len(), 0);
            }
        }
        bytes
    }
}

/// The frame of a pose.
fn pose() -> Vec<u8> {
    let properties = MapProperties {
        resolution_mm: 10,
        size_mm: [3_000; 2],
        layers: 1,
        position_mm: [1_500; 2],
        layer: 0,
        psi_deg: 90,
    };
    let mut frame = [0; FRAME_MAX];
    let len = encode_map_properties(&properties, &mut frame).unwrap_or(0);
    frame[..len].to_vec()
}

/// A transfer of the map.
struct Transfer {
    /// Time until all rows were there, seconds.
    time_s: f64,
    /// Rows that arrived, in their order.
    arrived: Vec<usize>,
    /// Number of rows that were sent.
    sent: usize,
}

impl Transfer {
    /// Share of lost rows, %.
    fn lost(&self) -> f64 {
        100.0 * (1.0 - self.arrived.len() as f64 / self.sent.max(1) as f64).max(0.0)
    }
}

/// Sends the map's rows again and again until all have arrived.
fn transfer_by(rows: &[Vec<u8>], baud: u32, seed: u64, buffer: Option<usize>) -> Transfer {
    let line = LineConfig::new_8n1(baud);
    let profile = Profile::default().at_baud(baud);
    let profile = match buffer {
        None => profile,
        Some(fifo_len) => Profile {
            fifo_len,
            ..profile
        },
    };
    let (mut rig, robot, host) = radio_bench(Hc06::new(profile, seed), line);
    rig.run_for(Duration::from_secs(5));
    let begun = rig.now();
    let mut decoder = Rows::default();
    let mut there = [false; ROWS];
    let mut sender = Sender {
        rows,
        row: usize::try_from(37 * seed).unwrap_or(0) % rows.len(),
        sent: 0,
        budget: 0.0,
    };
    let first = sender.row;
    let per_ms = 0.001 / line.byte_time().as_secs_f64();
    let (mut arrived, mut passes) = (Vec::new(), 0);
    for ms in 0.. {
        let before = sender.row;
        rig.inject(robot, &sender.bytes(ms, per_ms));
        if sender.row < before {
            passes += 1;
        }
        rig.run_for(Duration::from_millis(1));
        let bytes = rig.take_output(host);
        for frame in decoder.push(&bytes).flatten() {
            let is_row = matches!(&frame.id(), b"MAP" | b"MAR");
            if let ([_, low, high, ..], true) = (frame.payload(), is_row) {
                let y = usize::from(u16::from_le_bytes([*low, *high]));
                there.get_mut(y).into_iter().for_each(|row| *row = true);
                arrived.push(y);
            }
        }
        let time_s = (rig.now() - begun).as_secs_f64();
        if there.iter().all(|row| *row) || time_s >= GIVEN_UP_S {
            let sent = passes * rows.len() + sender.row - first;
            return Transfer {
                time_s,
                arrived,
                sent,
            };
        }
    }
    unreachable!("the loop ends by its time")
}

/// The same as time, s, and share of lost rows, %.
fn map_by(rows: &[Vec<u8>], baud: u32, seed: u64, model: Model) -> [f64; 2] {
    let transfer = transfer_by(rows, baud, seed, model.pick(None, Some(2_500)));
    [transfer.time_s, transfer.lost()]
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

/// Figure 12 (a): the map on the PC before it is complete.
pub(in super::super) const BUILDING: Measure = Measure {
    name: "building",
    planted: "a module with a buffer of 1300 bytes in place of 700",
    perform: building,
};

/// Buffer of a module, bytes, with which no burst of rows is lost; with 1000 bytes bursts are. The
/// picture has only short gaps.
const BUFFER: usize = 1_300;

fn building(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let rows = coded_rows();
    let ends = by_seed(plan, tell, |seed| {
        let buffer = model.pick(None, Some(BUFFER));
        let transfer = transfer_by(&rows, REPORTED_BAUD, seed, buffer);
        gaps(&transfer.arrived)
    });
    let mut measured = Measured::default();
    measured.value("rows that are missing (%)", ends.iter().map(|end| end[0]));
    measured.value("gaps of a single row (%)", ends.iter().map(|end| end[1]));
    measured
}

/// Share of the rows that are missing in the first 300, %, and share of the gaps that are a single
/// row, %.
fn gaps(rows: &[usize]) -> [f64; 2] {
    let Some(first) = rows.first() else {
        return [f64::NAN; 2];
    };
    let offsets = rows.iter().map(|row| (row + ROWS - first) % ROWS);
    let offsets: Vec<usize> = offsets.collect();
    // The second pass begins where the number falls.
    let Some(pass) = offsets.chunk_by(|row, next| row < next).next() else {
        return [f64::NAN; 2];
    };
    let skipped: Vec<usize> = pass
        .windows(2)
        .map(|pair| pair[1] - pair[0] - 1)
        .filter(|skipped| *skipped > 0)
        .collect();
    let single = skipped.iter().filter(|skipped| **skipped == 1).count();
    let missing = skipped.iter().sum::<usize>() as f64;
    [
        100.0 * missing / ROWS as f64,
        100.0 * single as f64 / skipped.len() as f64,
    ]
}
