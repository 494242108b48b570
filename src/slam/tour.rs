//! Runs a log through the mapper that closes loops.

use crate::slam::mapping::{Mapper, Outcome, Settings, Shot};
use emulators::world::Pose as Place;
use firmware_core::pose::{Point, Pose};

use super::Log;
use super::motion::moved;
use super::survey::{Jump, Sureness, Survey};
use crate::realtime::clock::{Clock, thread_cpu_time};

/// What is told to the mapper.
#[derive(Clone, Copy, Debug)]
pub struct Wish {
    /// Edge of a cell of the map, metres.
    pub cell_m: f64,
    /// Whether places seen again are looked for.
    pub closes_loops: bool,
    /// The wheels' errors, as a part of what is usual.
    pub noise: f64,
}

impl Default for Wish {
    fn default() -> Self {
        Self {
            cell_m: 0.05,
            closes_loops: true,
            noise: 1.0,
        }
    }
}

/// Maps `log`. `progress` is told the number of scans done, now and then.
pub fn tour(log: &Log, wish: &Wish, clock: &dyn Clock, progress: &mut dyn FnMut(usize)) -> Survey {
    let mut mapper = Mapper::new(Settings {
        closes_loops: wish.closes_loops,
        start: log.start,
        noise: wish.noise,
    });
    let mut survey = Survey::empty(log.shots.len());
    let before = thread_cpu_time();
    let mut here = log.start;
    for (done, shot) in log.shots.iter().enumerate() {
        if done % 64 == 0 {
            progress(done);
        }
        let began = clock.now();
        let ends: Vec<[f32; 2]> = shot.points.iter().map(metres).collect();
        let outcome = mapper.take(&Shot {
            moved: shot.moved,
            is_measured: shot.is_measured,
            ends: &ends,
        });
        survey.took.push(clock.now() - began);
        // The way begins with the first scan, whatever the wheels did before.
        let wheels = if done == 0 {
            here
        } else {
            moved(here, shot.moved)
        };
        let jump = Jump::between(shot.at_s, millimetres(wheels), millimetres(outcome.pose));
        survey.jumps.extend(jump.filter(|_| shot.is_measured));
        survey.sureness.push(sureness(&outcome));
        here = outcome.pose;
    }
    mapper.finish();
    survey.map = mapper.sheet(wish.cell_m);
    survey.cpu = before.and_then(|before| thread_cpu_time()?.checked_sub(before));
    let times = log.shots.iter().map(|shot| shot.at_s);
    survey.way = times.zip(mapper.way()).collect();
    let sure = survey.sureness.iter();
    survey.doubtful = sure.filter(|sure| sure.is_doubtful).count();
    survey.ambiguous = mapper.ambiguous();
    survey.dropped_loops = mapper.dropped_loops();
    survey.walls = mapper.walls();
    survey.graph = mapper.graph().clone();
    survey
}

fn sureness(outcome: &Outcome) -> Sureness {
    Sureness {
        quality: outcome.quality,
        deviation: [0, 1, 2].map(|axis| libm::sqrt(outcome.covariance[axis][axis].max(0.0))),
        is_doubtful: outcome.is_doubtful,
    }
}

fn metres(point: &Point) -> [f32; 2] {
    [point.x_mm / 1000.0, point.y_mm / 1000.0]
}

#[expect(clippy::cast_possible_truncation, reason = "millimetres of a building")]
fn millimetres(place: Place) -> Pose {
    Pose::new(
        (place.x * 1000.0) as f32,
        (place.y * 1000.0) as f32,
        place.theta as f32,
    )
}
