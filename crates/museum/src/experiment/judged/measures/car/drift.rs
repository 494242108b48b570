//! Drift of the gyroscope and of the steering.

use core::time::Duration;
use std::sync::{Arc, Mutex};

use emulators::world::wrap_angle;
use engine::rig::line::Direction;
use engine::rig::trace::{Side, Tap};
use engine::run::Run;
use protocols::Instant;

use super::driving::STRAIGHT;
use crate::experiment::Plan;
use crate::experiment::car::circle::angle_deg;
use crate::experiment::car::{told, way};
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::{Measure, Model, Told, by_seed};
use crate::experiment::runs::start;

/// Page 14: the gyroscope's angle climbs, and the steering drifts.
pub(in super::super) const DRIFT: Measure = Measure {
    name: "car-drift",
    planted: "a steering without drift",
    perform: drift,
};

/// Random change of the steering's trim after a metre, degrees: a setting of the rig.
const WANDER: &str = "[chassis.ackermann]\nsteering_wander_deg = 0.5\n";
/// Times between which the angle of the wheels is measured, seconds: at 0.22 m/s 11 m apart.
const EARLY_S: [u64; 2] = [4, 8];
const LATE_S: [u64; 2] = [54, 58];
/// Time of a car's drive with the gyroscope, seconds.
const MINUTE_S: [u64; 2] = [4, 64];

fn drift(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let wander = model.pick(WANDER, "");
    let found = by_seed(plan, tell, |seed| {
        let text = told([36.0, 36.0], [2, STRAIGHT], seed).scenario().to_toml();
        let mut run = start(&format!("{text}\n{wander}"), seed, |_| {});
        let mut angle = |[from, until]: [u64; 2]| {
            let [from, until] = [from, until].map(Duration::from_secs);
            angle_deg(&way(&mut run, from, until))
        };
        let early = angle(EARLY_S);
        [gyro_deg(seed), angle(LATE_S) - early]
    });
    let rms = |index: usize| {
        let squares = found.iter().map(|one| one[index] * one[index]);
        (squares.sum::<f64>() / found.len() as f64).sqrt()
    };
    let mut measured = Measured::default();
    measured.value(
        "error of the gyro angle after a minute, rms (deg)",
        [rms(0)],
    );
    measured.value("change of the steering after 11 m, rms (deg)", [rms(1)]);
    measured
}

/// Error of the gyroscope's angle after a minute of driving, degrees.
fn gyro_deg(seed: u64) -> f64 {
    let mut run = told([36.0, 36.0], [2, STRAIGHT], seed);
    let yaw = Yaw::of(&mut run);
    let mut at = |seconds: u64| {
        run.go_on_until(Instant::from_secs(seconds));
        yaw.last_rad() - run.rig.world.pose().theta
    };
    let [from, until] = MINUTE_S.map(&mut at);
    wrap_angle(until - from).to_degrees()
}

/// Bytes of the odometer's lines.
#[derive(Clone, Debug)]
struct Yaw {
    link: usize,
    text: Arc<Mutex<String>>,
}

impl Yaw {
    /// Listens to a run.
    fn of(run: &mut Run) -> Self {
        let mut links = run.rig.links().iter();
        let yaw = Self {
            link: links.position(|link| link.name == "odometer").unwrap_or(0),
            text: Arc::default(),
        };
        run.rig.add_tap(Box::new(yaw.clone()));
        yaw
    }

    /// The heading of the last complete line, radians: the third field.
    fn last_rad(&self) -> f64 {
        let text = self.text.lock().map(|text| text.clone());
        let text = text.unwrap_or_default();
        let complete = text.rfind('\n').map_or("", |end| &text[..end]);
        let field = complete
            .lines()
            .last()
            .and_then(|line| line.split('*').nth(2));
        field
            .and_then(|field| field.parse().ok())
            .unwrap_or(f64::NAN)
    }
}

impl Tap for Yaw {
    fn record(&mut self, link: usize, to: Direction, side: Side, _: Instant, bytes: &[u8]) {
        if (link, to, side) == (self.link, Direction::ToMaster, Side::Sent)
            && let Ok(mut text) = self.text.lock()
        {
            text.extend(bytes.iter().map(|byte| char::from(*byte)));
        }
    }
}
