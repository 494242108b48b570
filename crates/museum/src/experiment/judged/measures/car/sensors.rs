//! Hall sensor, encoder, odometer's lines, heights in the scan, and the emergency stop.

use core::time::Duration;
use std::sync::{Arc, Mutex};

use emulators::odometer::Odometer;
use engine::rig::line::Direction;
use engine::rig::trace::{Side, Tap};
use engine::run::Run;
use protocols::car_board::Decoder;
use protocols::{Decode as _, Instant};

use super::driving::STRAIGHT;
use crate::experiment::Plan;
use crate::experiment::car::hall::{GUESS, LOST, rates};
use crate::experiment::car::told;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_case, by_seed};
use crate::experiment::runs::{Spread, start};

/// Page 9: usable hall values.
pub(in super::super) const HALL: Measure = Measure {
    name: "car-hall",
    planted: "a host that loses no byte and takes whole frames",
    perform: hall,
};

fn hall(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let found = by_seed(plan, tell, |seed| {
        let rates = rates(seed);
        match model {
            Model::Sound => rates.fielded,
            Model::Planted => vec![rates.sound; LOST.len()],
        }
    });
    let of = |index: usize| found.iter().map(move |rates| rates[index]);
    let mut measured = Measured::default();
    for (index, lost) in LOST.into_iter().enumerate() {
        if lost == GUESS {
            measured.value("usable hall values (1/s)", of(index));
        }
    }
    let medians = LOST.into_iter().enumerate();
    let medians = medians.map(|(index, lost)| [lost, Spread::of(of(index)).median]);
    measured.curve("usable hall values", medians);
    measured
}

/// Chapters 3 and 6: counts of the encoder by speed.
pub(in super::super) const ENCODER: Measure = Measure {
    name: "car-encoder",
    planted: "a wheel a tenth larger, which counts as often a turn",
    perform: encoder,
};

const LEVELS: [i8; 7] = [-5, -4, -3, 2, 3, 4, 5];
/// Distance per count: a wheel of 32 mm, 60 counts a turn.
const COUNTS_PER_M: f64 = 298.4;
/// The encoder is at a rear wheel. In the tightest curve to the right the left wheel is the outer
/// one: it is faster than the middle of the axle by a tenth.
const WHEEL: &str = "rear_left";
const AT_WHEEL: &str = "[device.odometer.odometer]\nencoder = \"rear_left\"\n";
const RIGHT: i8 = 50;

fn encoder(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    // The odometer counts edges a metre of rim: a larger wheel has fewer.
    let share = model.pick(1.0, 1.0 / 1.1);
    let cases: Vec<(i8, i8)> = [STRAIGHT, RIGHT]
        .into_iter()
        .flat_map(|steering| LEVELS.map(|level| (level, steering)))
        .collect();
    let counts = by_case(plan, tell, &cases, |drive, seed| {
        share * counts_per_m(drive.into(), seed)
    });
    let of = |level: i8, steering: i8| {
        let index = cases.iter().position(|case| *case == (level, steering));
        counts[index.unwrap_or(0)].clone()
    };
    let shares = |level: i8| {
        let counts = of(level, RIGHT).into_iter();
        counts.map(|count| count / COUNTS_PER_M)
    };
    let mut measured = Measured::default();
    measured.value("counts a metre at level 2", of(2, STRAIGHT));
    measured.value("counts a metre at level -3", of(-3, STRAIGHT));
    measured.value("counts a metre at level 2 in a curve", of(2, RIGHT));
    measured.value("counts a metre at level -3 in a curve", of(-3, RIGHT));
    measured.value("share counted at level 3 in a curve", shares(3));
    measured.value("share counted at level -4 in a curve", shares(-4));
    for (name, steering) in [("straight ahead", STRAIGHT), ("in a curve", RIGHT)] {
        let median = |level: i8| {
            let median = Spread::of(of(level, steering)).median;
            [f64::from(level), median / COUNTS_PER_M]
        };
        measured.curve(name, LEVELS.map(median));
    }
    measured
}

/// Counts of the program a metre that the wheel rolls; negative if they run backwards.
fn counts_per_m([level, steering]: [i8; 2], seed: u64) -> f64 {
    let hall_m = if steering == STRAIGHT {
        [36.0, 8.0]
    } else {
        [12.0, 12.0]
    };
    let text = told(hall_m, [level, steering], seed).scenario().to_toml();
    let mut run = start(&format!("{text}\n{AT_WHEEL}"), seed, |_| {});
    let rolled = |run: &Run| {
        let mut encoders = run.rig.world.encoders().iter();
        let wheel = encoders.find(|encoder| encoder.name == WHEEL);
        let counts = run.rig.world.encoder(WHEEL).unwrap_or_default();
        wheel.map_or(f64::NAN, |wheel| counts as f64 / wheel.counts_per_m)
    };
    let mut at = |seconds: u64| {
        run.go_on_until(Instant::from_secs(seconds));
        let odometer = run.rig.device::<Odometer>("odometer");
        let counted = odometer.map_or(f64::NAN, |one| one.counted() as f64);
        [counted, rolled(&run)]
    };
    let (from, until) = (at(5), at(12));
    (until[0] - from[0]) / (until[1] - from[1])
}

fn car(level: i8, seed: u64, more: &str) -> Run {
    let run = told([36.0, 8.0], [level, STRAIGHT], seed);
    if more.is_empty() {
        return run;
    }
    let text = run.scenario().to_toml();
    start(&format!("{text}\n{more}"), seed, |_| {})
}

/// Chapter 2: lines of the odometer a second.
pub(in super::super) const LINES: Measure = Measure {
    name: "car-lines",
    planted: "the car's later sketch, whose loop takes 9.88 ms",
    perform: lines,
};

fn lines(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let found = by_seed(plan, tell, |seed| {
        let later = model.pick("", "[device.odometer.odometer]\nprogram = \"raw\"\n");
        let mut run = car(2, seed, later);
        let mut delivered = |seconds: u64| {
            run.go_on_until(Instant::from_secs(seconds));
            let mut lines = 0;
            if let Some(program) = run.rig.program() {
                program.counters(&mut |name, value| {
                    if name == "odometer lines" {
                        lines = value;
                    }
                });
            }
            lines as f64
        };
        let (from, until) = (delivered(4), delivered(14));
        (until - from) / 10.0
    });
    let mut measured = Measured::default();
    measured.value("lines a second", found);
    measured
}

/// Page 15: obstacles of 30 cm are not in the scan, obstacles of 40 cm are.
pub(in super::super) const HEIGHTS: Measure = Measure {
    name: "car-heights",
    planted: "a camera 6 cm lower",
    perform: heights,
};

/// A hall with a box ahead of the car.
fn hall_with(height_m: f64, camera_m: &str) -> String {
    format!(
        "schema = 1\nname = \"heights\"\nrobot = \"apollo13\"\nduration = \"6s\"\n\
         {camera_m}[world]\nstart = {{ x_m = 1, y_m = 2, heading_deg = 0 }}\n\
         [[world.wall]]\npath_m = [[0, 0], [5, 0], [5, 4], [0, 4], [0, 0]]\n\
         [[world.polygon]]\ncorners_m = [[2.8, 1.7], [3.2, 1.7], [3.2, 2.3], [2.8, 2.3]]\n\
         height_m = {height_m}\n"
    )
}

fn heights(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let camera = model.pick("", "[device.camera.camera]\nheight_m = 0.28\n");
    let seen = by_case(plan, tell, &[0.30, 0.40], |height_m, seed| {
        let mut run = start(&hall_with(height_m, camera), seed, |_| {});
        run.go_on_until(Instant::ZERO + Duration::from_secs(5));
        let scan = run.rig.program().map(|program| program.scan().to_vec());
        let ahead = scan.unwrap_or_default();
        // Straight ahead of the camera.
        let ahead = ahead.iter().filter(|point| point.y_mm.abs() < 100.0);
        let nearest = ahead
            .map(|point| f64::from(point.x_mm))
            .fold(f64::NAN, f64::min);
        nearest / 1_000.0
    });
    let mut measured = Measured::default();
    measured.value("distance ahead with a box of 30 cm (m)", seen[0].clone());
    measured.value("distance ahead with a box of 40 cm (m)", seen[1].clone());
    measured
}

/// Chapter 2: pulses of the hall sensor a metre.
pub(in super::super) const PULSES: Measure = Measure {
    name: "car-pulses",
    planted: "a tenth of the distance is lost to slip",
    perform: pulses,
};

fn pulses(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let slip = model.pick("", "[chassis.ackermann]\nslip = 0.1\n");
    let found = by_seed(plan, tell, |seed| {
        let mut run = car(2, seed, slip);
        let bytes = Recorded::default();
        run.rig.add_tap(Box::new(bytes.clone()));
        run.go_on_until(Instant::from_secs(5));
        let start = run.rig.world.pose();
        run.go_on_until(Instant::from_secs(35));
        let far_m = start.point().distance(run.rig.world.pose().point());
        let car = link(&run, "car");
        let sent = bytes.of(car, Direction::ToMaster);
        let halls = |from: u64, until: u64| {
            let (from, until) = (Instant::from_secs(from), Instant::from_secs(until));
            let inside = sent.iter().filter(|(at, _)| (from..until).contains(at));
            let bytes: Vec<u8> = inside.map(|(_, byte)| *byte).collect();
            let mut decoder = Decoder::default();
            let frames: Vec<_> = decoder.push(&bytes).flatten().collect();
            frames.last().map(|frame| f64::from(frame.readings().hall))
        };
        let ends = halls(3, 5).zip(halls(33, 35));
        ends.map_or(f64::NAN, |(from, until)| (until - from) / far_m)
    });
    let mut measured = Measured::default();
    measured.value("pulses a metre", found);
    measured
}

/// Chapter 5: the emergency stop.
pub(in super::super) const STOP: Measure = Measure {
    name: "car-stop",
    planted: "a phone whose packets arrive 100 ms late",
    perform: stop,
};

/// The motor byte of a standing car.
const MOTOR_OFF: u8 = 0x8A;
/// Time of the emergency stop of seed 0, and how much later it is with each seed: another phase of
/// the program's cycle.
const STOP_AT_MS: u64 = 4_000;
const LATER_MS: u64 = 5;
/// Time before the stop in which the motor must run.
const BEFORE: Duration = Duration::from_millis(500);

fn stop(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let found = by_seed(plan, tell, |seed| {
        let text = told([12.0, 6.0], [2, 8], seed).scenario().to_toml();
        let late = "[[fault]]\nkind = \"latency\"\nlink = \"remote\"\ndirection = \"to-master\"\n\
            by = \"100ms\"\n";
        let begin_ms = STOP_AT_MS + LATER_MS * (seed % 100);
        let text = format!(
            "{text}\n[[mission.step]]\nat = \"{begin_ms}ms\"\ndo = {{ mode = \"stop\" }}\n{}",
            model.pick("", late)
        );
        let mut run = start(&text, seed, |_| {});
        let bytes = Recorded::default();
        run.rig.add_tap(Box::new(bytes.clone()));
        let begin = Instant::from_millis(begin_ms);
        run.go_on_until(begin + Duration::from_secs(1));
        let sent = bytes.of(link(&run, "car"), Direction::ToDevice);
        let mut before = sent
            .iter()
            .filter(|(at, _)| *at < begin && *at + BEFORE >= begin)
            .peekable();
        if before.peek().is_none() || before.any(|(_, byte)| *byte == MOTOR_OFF) {
            return f64::NAN;
        }
        let off = sent
            .iter()
            .find(|(at, byte)| *at >= begin && *byte == MOTOR_OFF);
        off.map_or(f64::NAN, |(at, _)| 1_000.0 * (*at - begin).as_secs_f64())
    });
    let mut measured = Measured::default();
    measured.value("time until the motor is off (ms)", found);
    measured
}

/// A byte as it was sent.
#[derive(Clone, Copy, Debug)]
struct Byte {
    link: usize,
    to: Direction,
    at: Instant,
    byte: u8,
}

/// Bytes of all links.
#[derive(Clone, Debug, Default)]
struct Recorded(Arc<Mutex<Vec<Byte>>>);

impl Recorded {
    /// Bytes of one direction of a link.
    fn of(&self, link: usize, to: Direction) -> Vec<(Instant, u8)> {
        let all = self.0.lock().map(|all| all.clone()).unwrap_or_default();
        let of_line = all
            .into_iter()
            .filter(|one| (one.link, one.to) == (link, to));
        of_line.map(|one| (one.at, one.byte)).collect()
    }
}

impl Tap for Recorded {
    fn record(&mut self, link: usize, to: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if side == Side::Sent
            && let Ok(mut all) = self.0.lock()
        {
            let byte = |byte: &u8| Byte {
                link,
                to,
                at,
                byte: *byte,
            };
            all.extend(bytes.iter().map(byte));
        }
    }
}

/// Number of a link.
fn link(run: &Run, name: &str) -> usize {
    let links = run.rig.links().iter();
    let mut numbers = links.enumerate().filter(|(_, link)| link.name == name);
    numbers.next().map_or(usize::MAX, |(number, _)| number)
}
