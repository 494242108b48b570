//! Values of devices that are described by data: their sources and limits.

mod sink;

use core::time::Duration;

use protocols::Instant;

use crate::device::EventKind;
use crate::event_log::EventLog;
use crate::world::{Chassis, Wheel, World};
pub use sink::{Sink, SinkKind, Wanted};

/// A named whole number of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Stable name, unique in its device.
    pub name: String,
    /// Value at the start of the run.
    pub initial: i64,
    /// Minimum and maximum value that a master may write.
    pub limits: [i64; 2],
    /// Value that it takes when the master has been silent for the device's watchdog time.
    pub safe: Option<i64>,
    /// Source of the value.
    pub source: ValueSource,
    /// Effect on the world when the value changes.
    pub drives: Option<Sink>,
}

/// Source of a value. All but [`Stored`](Self::Stored) are read-only.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ValueSource {
    /// The value written last.
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
    /// Encoder counts of a wheel since the start of the run, from the initial value on.
    Encoder(Wheel),
    /// Encoder counts since the start of the run, added to the initial value, of the chassis's
    /// encoder of this name; none if the chassis has no such encoder, see [`Wanted`].
    EncoderNamed(String),
    /// Position of the robot in the world, millimetres along x.
    XMm,
    /// Position of the robot in the world, millimetres along y.
    YMm,
    /// Heading of the robot in the world, milliradians, counter-clockwise from x.
    HeadingMrad,
    /// Speed over the floor in any direction, millimetres per second.
    SpeedMmS,
    /// Turn rate, milliradians per second, counter-clockwise.
    TurnRateMradS,
    /// 1 while the body touches a surface that it has met, otherwise 0.
    Touching,
    /// Collisions since the start of the run.
    Contacts,
    /// Distance from the middle of the robot to the nearest surface, millimetres, an ideal beam.
    RangeMm {
        /// Direction of the beam, radians counter-clockwise from ahead.
        angle: f64,
        /// Value if there is no nearer surface.
        max_mm: i64,
    },
}

impl ValueSource {
    /// The value in `world`, `elapsed` after its start. `initial` is the value at the start,
    /// `stored` the value written last.
    pub fn read(&self, [initial, stored]: [i64; 2], elapsed: Duration, world: &World) -> i64 {
        let elapsed = elapsed.as_nanos();
        match self {
            Self::Stored => stored,
            Self::Counter { period } => {
                let counts = elapsed / period.as_nanos().max(1);
                stored.saturating_add(i64::try_from(counts).unwrap_or(i64::MAX))
            }
            Self::Ramp { from, to, period } => {
                let nanos = period.as_nanos().max(1);
                let share = i128::try_from(elapsed % nanos).unwrap_or(0);
                let rise = i128::from(*to - *from) * share / i128::try_from(nanos).unwrap_or(1);
                *from + i64::try_from(rise).unwrap_or(0)
            }
            Self::Encoder(wheel) => {
                let counts = world.encoder_ticks(*wheel);
                initial.saturating_add(counts)
            }
            Self::EncoderNamed(name) => {
                let counts = world.encoder(name).unwrap_or(0);
                initial.saturating_add(counts)
            }
            Self::SpeedMmS => whole(world.speed() * 1000.0),
            Self::TurnRateMradS => whole(world.turn_rate() * 1000.0),
            Self::Touching => i64::from(world.is_touching()),
            Self::Contacts => i64::try_from(world.contact_count()).unwrap_or(i64::MAX),
            Self::XMm => whole(world.pose().x * 1000.0),
            Self::YMm => whole(world.pose().y * 1000.0),
            Self::HeadingMrad => whole(world.pose().theta * 1000.0),
            Self::RangeMm { angle, max_mm } => {
                let pose = world.pose();
                #[expect(clippy::cast_precision_loss, reason = "a range is below 2^53 mm")]
                let max_m = *max_mm as f64 / 1000.0;
                let hit = world.cast_ray(pose.point(), pose.theta + angle, max_m);
                hit.map_or(*max_mm, |hit| whole(hit.distance * 1000.0))
            }
        }
    }

    /// Whether the source counts from the initial value.
    const fn begins_anywhere(&self) -> bool {
        matches!(
            self,
            Self::Stored | Self::Counter { .. } | Self::Encoder(_) | Self::EncoderNamed(_)
        )
    }
}

/// Reason for invalid variables.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VariableError {
    /// Index in the list.
    pub index: usize,
    /// The error, and the expected value.
    pub message: String,
}

/// The variables of a device with their current values.
#[derive(Clone, Debug)]
pub(crate) struct Variables {
    known: Vec<Variable>,
    values: Vec<i64>,
    /// The commands sent last to the actuators; 0 if none was sent.
    told: Vec<i64>,
    /// Time since which an actuator needs a new command.
    changed_at: Option<Instant>,
    /// Start time of counters and ramps.
    began: Instant,
}

impl Variables {
    pub(crate) fn new(known: Vec<Variable>) -> Result<Self, VariableError> {
        for (index, variable) in known.iter().enumerate() {
            let before = &known[..index];
            if let Some(message) = variable.fault(before) {
                return Err(VariableError { index, message });
            }
        }
        let mut variables = Self {
            values: known.iter().map(|variable| variable.initial).collect(),
            told: vec![0; known.len()],
            changed_at: None,
            began: Instant::ZERO,
            known,
        };
        variables.note_change(Instant::ZERO);
        Ok(variables)
    }

    /// Encoders and actuators that the variables need, each with the variable's index.
    pub(crate) fn wanted(&self) -> impl Iterator<Item = (usize, Wanted<'_>)> {
        self.known.iter().enumerate().flat_map(|(index, variable)| {
            let encoder = match &variable.source {
                ValueSource::Encoder(wheel) => Some(wheel.name()),
                ValueSource::EncoderNamed(name) => Some(name.as_str()),
                _ => None,
            };
            let sink = variable.drives.as_ref().map(Wanted::Actuator);
            let wanted = encoder.map(Wanted::Encoder).into_iter().chain(sink);
            wanted.map(move |wanted| (index, wanted))
        })
    }

    /// Reports the first variable that `chassis` has no actuator or encoder for.
    pub(crate) fn check_chassis(&self, chassis: &dyn Chassis) -> Result<(), VariableError> {
        for (index, wanted) in self.wanted() {
            if let Some(message) = wanted.missing(chassis) {
                return Err(VariableError { index, message });
            }
        }
        Ok(())
    }

    /// Sends changed values to the actuators.
    pub(crate) fn drive(&mut self, now: Instant, world: &mut World, log: &mut EventLog) {
        if self.changed_at.take().is_none() {
            return;
        }
        let values = self.values.iter().zip(&mut self.told);
        for (variable, (&value, told)) in self.known.iter().zip(values) {
            let Some(sink) = variable.drives.as_ref().filter(|_| *told != value) else {
                continue;
            };
            *told = value;
            if let Err(error) = world.actuate(&sink.actuator, sink.command(value)) {
                let detail = || format!("{}: {error}", variable.name);
                log.repeated(now, EventKind::Note, "not-driven", detail);
            }
        }
    }

    /// Time since which [`drive`](Self::drive) has had work.
    pub(crate) fn changed_at(&self) -> Option<Instant> {
        self.changed_at
    }

    fn note_change(&mut self, at: Instant) {
        let known = self.known.iter().zip(self.values.iter().zip(&self.told));
        let mut changed = known.filter(|(variable, _)| variable.drives.is_some());
        if changed.any(|(_, (value, told))| value != told) {
            self.changed_at.get_or_insert(at);
        }
    }

    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.known.iter().position(|variable| variable.name == name)
    }

    pub(crate) fn get(&self, index: usize) -> &Variable {
        &self.known[index]
    }

    /// Value that a master reads at `now`.
    pub(crate) fn read(&self, index: usize, now: Instant, world: &World) -> i64 {
        let variable = &self.known[index];
        let stored = self.values[index];
        let source = &variable.source;
        source.read([variable.initial, stored], now - self.began, world)
    }

    /// Stores `value`, or the nearest allowed one; returns whether `value` was allowed.
    pub(crate) fn write(&mut self, at: Instant, index: usize, value: i64) -> bool {
        let [least, greatest] = self.known[index].limits;
        self.values[index] = value.clamp(least, greatest);
        self.note_change(at);
        self.values[index] == value
    }

    /// Sets the value called `name`, unless it has a source of its own or would leave its limits.
    pub(crate) fn set(&mut self, at: Instant, name: &str, value: i64) -> Result<(), String> {
        let Some(index) = self.find(name) else {
            let known: Vec<&str> = self.known.iter().map(|one| &*one.name).collect();
            return Err(format!(
                "is \"{name}\", expected one of {}",
                known.join(", ")
            ));
        };
        let variable = &self.known[index];
        let [least, greatest] = variable.limits;
        if variable.source != ValueSource::Stored {
            return Err(format!(
                "{name} has its own source, expected a stored value"
            ));
        }
        if !(least..=greatest).contains(&value) {
            return Err(format!("{name} = {value}, expected {least} to {greatest}"));
        }
        self.write(at, index, value);
        Ok(())
    }

    /// Resets everything to its state at the start.
    pub(crate) fn restart(&mut self, at: Instant) {
        let initial = self.known.iter().map(|variable| variable.initial);
        self.values = initial.collect();
        self.began = at;
        self.note_change(at);
    }

    /// Sets the safe values of a silent master; returns whether any value changed.
    pub(crate) fn make_safe(&mut self, at: Instant) -> bool {
        let before = self.values.clone();
        for (value, variable) in self.values.iter_mut().zip(&self.known) {
            *value = variable.safe.unwrap_or(*value);
        }
        self.note_change(at);
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
    /// A watchdog whose master counts as silent `time` after its last message; `None`: never.
    pub(crate) const fn new(time: Option<Duration>) -> Self {
        let silent_at = None;
        Self { time, silent_at }
    }

    /// Restarts the watchdog after a message of the master.
    pub(crate) fn heard(&mut self, at: Instant) {
        self.silent_at = self.time.map(|time| at + time);
    }

    /// Time at which the master will count as silent.
    pub(crate) const fn silent_at(&self) -> Option<Instant> {
        self.silent_at
    }

    /// Makes `variables` safe if the master is silent by `now`.
    pub(crate) fn poll(&mut self, now: Instant, variables: &mut Variables, log: &mut EventLog) {
        if self.silent_at.take_if(|at| *at <= now).is_some() && variables.make_safe(now) {
            let detail = "the master is silent: variables are set to their safe values".to_owned();
            log.note(now, "made-safe", detail);
        }
    }
}

impl Variable {
    /// The error of this variable; `before` are the variables in front of it.
    fn fault(&self, before: &[Self]) -> Option<String> {
        let Self { name, initial, .. } = self;
        let [least, greatest] = self.limits;
        let within = |value: i64| (least..=greatest).contains(&value);
        let periods = match &self.source {
            ValueSource::Counter { period } | ValueSource::Ramp { period, .. } => Some(*period),
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
            Some(format!(
                "name \"{name}\" is used twice, expected another name"
            ))
        } else if least > greatest {
            Some(format!(
                "limits are {least} and {greatest}, expected the lower one first"
            ))
        } else if !within(*initial) {
            Some(format!(
                "initial is {initial}, expected {least} to {greatest}"
            ))
        } else if let Some(safe) = self.safe.filter(|&safe| !within(safe)) {
            Some(format!("safe is {safe}, expected {least} to {greatest}"))
        } else if *initial != 0 && !self.source.begins_anywhere() {
            Some(format!(
                "initial is {initial}, expected none: the source sets the value at the start"
            ))
        } else if periods.is_some_and(|period| period.is_zero()) {
            Some("its period is 0, expected a time".to_owned())
        } else {
            self.drives.as_ref().and_then(|sink| self.sink_fault(sink))
        }
    }

    fn sink_fault(&self, sink: &Sink) -> Option<String> {
        let Sink {
            actuator, scale, ..
        } = sink;
        if !self.is_stored() {
            Some(format!(
                "it drives {actuator} and has a source, expected one of them"
            ))
        } else if actuator.is_empty() {
            Some("it drives an actuator without a name".to_owned())
        } else if !scale.is_finite() || *scale == 0.0 {
            Some(format!(
                "its scale is {scale}, expected a figure other than 0"
            ))
        } else {
            None
        }
    }

    /// Whether a master can change it.
    pub(crate) fn is_stored(&self) -> bool {
        self.source == ValueSource::Stored
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
pub(crate) mod tests;
