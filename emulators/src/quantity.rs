//! Values of devices that are described by data: where they come from, what they may be.

use core::time::Duration;

use protocols::Instant;

use crate::event_log::EventLog;
use crate::world::{Wheel, World};

/// A named whole number of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Stable name, unique in its device.
    pub name: String,
    /// At the start of the run.
    pub initial: i64,
    /// Least and greatest value that a master may write.
    pub limits: [i64; 2],
    /// Taken on when the master has been silent for the device's watchdog time.
    pub safe: Option<i64>,
    /// Where it comes from.
    pub source: Source,
}

/// Where a value comes from. All but [`Stored`](Self::Stored) are read-only.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Source {
    /// What was written last.
    #[default]
    Stored,
    /// Counts up from the initial value, one each period.
    Counter {
        /// Time of one count.
        period: Duration,
    },
    /// Rises or falls evenly from one value to another, then begins again.
    Ramp {
        /// At the beginning of a period.
        from: i64,
        /// Reached at the end of a period.
        to: i64,
        /// Time of one rise.
        period: Duration,
    },
    /// Encoder counts of a wheel since the start of the run.
    Encoder(Wheel),
    /// Where the robot is in the world, millimetres along x.
    XMm,
    /// Where the robot is in the world, millimetres along y.
    YMm,
    /// Where the robot looks in the world, milliradians, counter-clockwise from x.
    HeadingMrad,
    /// Distance from the middle of the robot to what is there, millimetres, an ideal beam.
    RangeMm {
        /// Where the beam goes, radians counter-clockwise from ahead.
        angle: f64,
        /// Shown when nothing is nearer.
        max_mm: i64,
    },
}

/// Why variables cannot be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VariableError {
    /// Place in the list.
    pub index: usize,
    /// What is wrong with it and what was expected.
    pub message: String,
}

/// The variables of a device, and what they are now.
#[derive(Clone, Debug)]
pub(crate) struct Variables {
    known: Vec<Variable>,
    values: Vec<i64>,
}

impl Variables {
    pub(crate) fn new(known: Vec<Variable>) -> Result<Self, VariableError> {
        for (index, variable) in known.iter().enumerate() {
            let before = &known[..index];
            if let Some(message) = variable.fault(before) {
                return Err(VariableError { index, message });
            }
        }
        let values = known.iter().map(|variable| variable.initial).collect();
        Ok(Self { known, values })
    }

    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.known.iter().position(|variable| variable.name == name)
    }

    pub(crate) fn get(&self, index: usize) -> &Variable {
        &self.known[index]
    }

    /// What a master reads at `now`.
    pub(crate) fn read(&self, index: usize, now: Instant, world: &World) -> i64 {
        let elapsed = (now - Instant::ZERO).as_nanos();
        match self.known[index].source {
            Source::Stored => self.values[index],
            Source::Counter { period } => {
                let counts = elapsed / period.as_nanos().max(1);
                self.values[index].saturating_add(i64::try_from(counts).unwrap_or(i64::MAX))
            }
            Source::Ramp { from, to, period } => {
                let nanos = period.as_nanos().max(1);
                let share = i128::try_from(elapsed % nanos).unwrap_or(0);
                let rise = i128::from(to - from) * share / i128::try_from(nanos).unwrap_or(1);
                from + i64::try_from(rise).unwrap_or(0)
            }
            Source::Encoder(wheel) => world.encoder_ticks(wheel),
            Source::XMm => whole(world.pose().x * 1000.0),
            Source::YMm => whole(world.pose().y * 1000.0),
            Source::HeadingMrad => whole(world.pose().theta * 1000.0),
            Source::RangeMm { angle, max_mm } => {
                let pose = world.pose();
                #[expect(clippy::cast_precision_loss, reason = "a range is below 2^53 mm")]
                let max_m = max_mm as f64 / 1000.0;
                let hit = world.cast_ray(pose.point(), pose.theta + angle, max_m);
                hit.map_or(max_mm, |hit| whole(hit.distance * 1000.0))
            }
        }
    }

    /// Takes `value`, or the nearest that is allowed; whether it was allowed.
    pub(crate) fn write(&mut self, index: usize, value: i64) -> bool {
        let [least, greatest] = self.known[index].limits;
        self.values[index] = value.clamp(least, greatest);
        self.values[index] == value
    }

    /// The master is silent: whether any value changed by it.
    pub(crate) fn make_safe(&mut self) -> bool {
        let before = self.values.clone();
        for (value, variable) in self.values.iter_mut().zip(&self.known) {
            *value = variable.safe.unwrap_or(*value);
        }
        before != self.values
    }
}

/// Waits for a master to fall silent.
#[derive(Clone, Debug)]
pub(crate) struct Watchdog {
    time: Option<Duration>,
    silent_at: Option<Instant>,
}

impl Watchdog {
    /// `time` after it was last heard a master counts as silent; `None`: never.
    pub(crate) const fn new(time: Option<Duration>) -> Self {
        let silent_at = None;
        Self { time, silent_at }
    }

    /// The master said something.
    pub(crate) fn heard(&mut self, at: Instant) {
        self.silent_at = self.time.map(|time| at + time);
    }

    /// When the master will count as silent.
    pub(crate) const fn silent_at(&self) -> Option<Instant> {
        self.silent_at
    }

    /// Makes `variables` safe if the master is silent by `now`.
    pub(crate) fn poll(&mut self, now: Instant, variables: &mut Variables, log: &mut EventLog) {
        if self.silent_at.take_if(|at| *at <= now).is_some() && variables.make_safe() {
            let detail = "the master is silent: values are safe now".to_owned();
            log.note(now, "made-safe", detail);
        }
    }
}

impl Variable {
    /// What is wrong with it behind those `before` it.
    fn fault(&self, before: &[Self]) -> Option<String> {
        let Self { name, initial, .. } = self;
        let [least, greatest] = self.limits;
        let within = |value: i64| (least..=greatest).contains(&value);
        let periods = match self.source {
            Source::Counter { period } | Source::Ramp { period, .. } => Some(period),
            _ => None,
        };
        if name.is_empty()
            || !name
                .chars()
                .all(|c| c.is_ascii_alphanumeric() || "-_".contains(c))
        {
            Some(format!(
                "name is \"{name}\", expected letters, digits, '-' and '_'"
            ))
        } else if before.iter().any(|other| other.name == *name) {
            Some(format!("name \"{name}\" is taken, expected one of its own"))
        } else if least > greatest {
            Some(format!(
                "limits are {least} and {greatest}, expected least and greatest"
            ))
        } else if !within(*initial) {
            Some(format!(
                "initial is {initial}, expected {least} to {greatest}"
            ))
        } else if let Some(safe) = self.safe.filter(|&safe| !within(safe)) {
            Some(format!("safe is {safe}, expected {least} to {greatest}"))
        } else if periods.is_some_and(|period| period.is_zero()) {
            Some("its period is 0, expected a time".to_owned())
        } else {
            None
        }
    }

    /// Whether a master can change it.
    pub(crate) fn is_stored(&self) -> bool {
        self.source == Source::Stored
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "the world is smaller than 2^63 mm"
)]
fn whole(value: f64) -> i64 {
    value.round() as i64
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::world::{BodyConfig, Fixture, Point, Pose, Scene, Shape};

    /// A robot at (1, 0.5) that looks along x at a wall 2 m ahead.
    pub(crate) fn world() -> World {
        let wall = Fixture {
            shape: Shape::Wall {
                from: Point::new(3.0, -1.0),
                to: Point::new(3.0, 2.0),
            },
            reflectivity: 1.0,
        };
        let scene = Scene::new([wall], vec![]).expect("a wall");
        let pose = Pose::new(1.0, 0.5, 0.0);
        World::new(scene, BodyConfig::default(), pose, 1).expect("free")
    }

    pub(crate) fn variable(name: &str, source: Source) -> Variable {
        Variable {
            name: name.to_owned(),
            initial: 0,
            limits: [-100, 100],
            safe: None,
            source,
        }
    }

    #[test]
    fn each_source_shows_what_can_be_worked_out_by_hand() {
        let ms = Duration::from_millis;
        let range = |angle| Source::RangeMm {
            angle,
            max_mm: 2500,
        };
        let ramp = Source::Ramp {
            from: 10,
            to: -10,
            period: ms(100),
        };
        let sources = [
            Source::Counter { period: ms(20) },
            ramp,
            Source::XMm,
            Source::YMm,
            Source::HeadingMrad,
            Source::Encoder(Wheel::Left),
            range(0.0),
            range(core::f64::consts::PI),
        ];
        let names = ["a", "b", "c", "d", "e", "f", "g", "h"];
        let known = names.iter().zip(sources).map(|(name, s)| variable(name, s));
        let variables = Variables::new(known.collect()).expect("sound");
        let read = |index| variables.read(index, Instant::from_millis(125), &world());
        // 125 ms are 6 counts of 20 ms, and a quarter of the second ramp.
        assert_eq!([0, 1, 2, 3, 4, 5].map(read), [6, 5, 1000, 500, 0, 0]);
        assert_eq!([6, 7].map(read), [2000, 2500]);
    }

    #[test]
    fn variables_that_cannot_be_are_refused() {
        let fault = |change: fn(&mut Variable)| {
            let mut second = variable("b", Source::Stored);
            change(&mut second);
            let error = Variables::new(vec![variable("a", Source::Stored), second]);
            let error = error.expect_err("unsound");
            assert_eq!(error.index, 1);
            error.message
        };
        assert!(fault(|v| v.name = "a".into()).contains("is taken"));
        assert!(fault(|v| v.name = "a b".into()).contains("expected letters"));
        assert!(fault(|v| v.initial = 101).contains("initial is 101"));
        assert!(fault(|v| v.safe = Some(-101)).contains("safe is -101"));
        assert!(fault(|v| v.limits = [1, 0]).contains("least and greatest"));
        let period = Duration::ZERO;
        assert!(Variables::new(vec![variable("a", Source::Counter { period })]).is_err());
    }
}
