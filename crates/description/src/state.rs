//! Variables of a device: sources and limits of their values.

mod recording;

use core::f64::consts::TAU;
use core::time::Duration;
use std::borrow::Cow;
use std::sync::Arc;

use emulators::rng::Rng;
use emulators::world::World;
use protocols::Instant;

use crate::expr::{Expr, Scope};
use crate::field::Names;
use crate::schema::state::WorldQuantity;
use crate::value::{Value, is_same};

pub(crate) use recording::{Recording, RecordingError};

/// A compiled variable.
#[derive(Clone, Debug)]
pub(crate) struct Variable {
    pub(crate) name: Arc<str>,
    pub(crate) initial: Value,
    pub(crate) unit: String,
    pub(crate) limits: Option<[f64; 2]>,
    pub(crate) names: Option<Names>,
    pub(crate) source: Source,
    pub(crate) safe: Option<Value>,
    pub(crate) keeps: bool,
    pub(crate) about: String,
}

/// The source of a value.
#[derive(Clone, Debug)]
pub(crate) enum Source {
    Stored,
    Counter(Duration),
    Ramp {
        from: f64,
        to: f64,
        period: Duration,
    },
    Sine {
        mean: f64,
        amplitude: f64,
        period: Duration,
    },
    Noise {
        mean: f64,
        deviation: f64,
        period: Duration,
    },
    Recorded {
        recording: Arc<Recording>,
        repeats: bool,
    },
    World(WorldQuantity),
    Computed(Expr),
}

/// Maximum range of a ray, metres.
const RANGE_MAX_M: f64 = 10.0;

/// Values of the variables.
#[derive(Clone, Debug)]
pub(crate) struct State {
    known: Arc<Vec<Variable>>,
    values: Vec<Value>,
    began: Instant,
    seed: u64,
    name: String,
    /// Effects of active faults on values.
    pub(crate) overlays: Vec<Overlay>,
}

/// The effect of a fault on a variable.
#[derive(Clone, Debug)]
pub(crate) struct Overlay {
    pub(crate) variable: usize,
    pub(crate) change: Change,
}

/// The change of a value.
#[derive(Clone, Debug)]
pub(crate) enum Change {
    Frozen(Value),
    Factor(f64),
    Computed { expr: Expr, figure: f64 },
}

/// The state at one time in a world: the scope of expressions.
pub(crate) struct Reading<'a> {
    pub(crate) state: &'a State,
    pub(crate) now: Instant,
    pub(crate) world: &'a World,
}

impl Scope for Reading<'_> {
    fn value(&self, name: &str) -> Option<Value> {
        let index = self.state.find(name)?;
        Some(self.state.read(index, self.now, self.world))
    }

    fn find(&self, name: &str) -> Option<Cow<'_, Value>> {
        let index = self.state.find(name)?;
        Some(self.state.look(index, self.now, self.world))
    }
}

/// The scope of a fault's expression: also the value without the fault, and the scenario's figure.
struct Faulty<'a> {
    reading: Reading<'a>,
    value: &'a Value,
    figure: f64,
}

impl Scope for Faulty<'_> {
    fn value(&self, name: &str) -> Option<Value> {
        match name {
            "self" => Some(self.value.clone()),
            "factor" => Some(Value::Float(self.figure)),
            name => self.reading.value(name),
        }
    }
}

impl Variable {
    /// Whether only the device changes the variable.
    pub(crate) const fn is_measured(&self) -> bool {
        !matches!(self.source, Source::Stored)
    }

    /// The value in words.
    pub(crate) fn words(&self, value: &Value) -> String {
        let named = self.names.as_ref().zip(value.as_int());
        if let Some(name) = named.and_then(|(names, int)| names.get(&int)) {
            return name.clone();
        }
        match self.unit.as_str() {
            "" => value.to_string(),
            unit => format!("{value} {unit}"),
        }
    }
}

impl State {
    /// The values at the start of a run; `seed` and `name` select the noise.
    pub(crate) fn new(known: Arc<Vec<Variable>>, seed: u64, name: &str) -> Self {
        Self {
            values: known
                .iter()
                .map(|variable| variable.initial.clone())
                .collect(),
            known,
            began: Instant::ZERO,
            seed,
            name: name.to_owned(),
            overlays: Vec::new(),
        }
    }

    /// The index of the variable called `name`; the prefix `state.` is allowed.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        let name = name.strip_prefix("state.").unwrap_or(name);
        self.known
            .iter()
            .position(|variable| is_same(&variable.name, name))
    }

    /// Restarts the device.
    pub(crate) fn restart(&mut self, now: Instant) {
        for (value, variable) in self.values.iter_mut().zip(self.known.iter()) {
            if !variable.keeps {
                value.clone_from(&variable.initial);
            }
        }
        self.began = now;
    }

    /// Sets the safe values after a silence of the driver; returns whether a value changed.
    pub(crate) fn make_safe(&mut self) -> bool {
        let mut is_changed = false;
        for (value, variable) in self.values.iter_mut().zip(self.known.iter()) {
            if let Some(safe) = variable.safe.as_ref().filter(|safe| *safe != value) {
                value.clone_from(safe);
                is_changed = true;
            }
        }
        is_changed
    }

    /// Sets the variable called `name` from outside.
    pub(crate) fn set(&mut self, name: &str, value: Value) -> Result<(), String> {
        let Some(index) = self.find(name) else {
            let known: Vec<&str> = self.known.iter().map(|one| &*one.name).collect();
            return Err(span::near::expected(name, &known));
        };
        if !matches!(self.known[index].source, Source::Stored) {
            return Err(format!(
                "{name} has its own source, expected a stored value"
            ));
        }
        let value = match (value, &self.known[index].names) {
            (Value::Text(text), Some(names)) => {
                let named = names.iter().find(|(_, name)| **name == text);
                let (number, _) = named.ok_or_else(|| {
                    let known: Vec<&str> = names.values().map(String::as_str).collect();
                    format!("{name} is \"{text}\", expected one of {}", known.join(", "))
                })?;
                Value::Int(*number)
            }
            (value, _) => value,
        };
        let is_number = |value: &Value| value.as_f64().is_some();
        let was = &self.values[index];
        if is_number(was) != is_number(&value) {
            return Err(format!(
                "{name} is {}, expected {}",
                value.kind(),
                was.kind()
            ));
        }
        let value = match (was, value) {
            (Value::Float(_), Value::Int(int)) =>
            {
                #[expect(clippy::cast_precision_loss, reason = "the nearest number is meant")]
                Value::Float(int as f64)
            }
            (Value::Int(_), Value::Float(float)) => Value::Float(float),
            (_, value) => value,
        };
        let words = value.to_string();
        match self.write(index, value) {
            true => Ok(()),
            false => Err(format!("{name} = {words} is beyond its limits")),
        }
    }

    /// Stores a value. Beyond the limits, stores the nearer limit and returns `false`.
    pub(crate) fn write(&mut self, index: usize, value: Value) -> bool {
        let variable = &self.known[index];
        let limits = variable.limits;
        let (value, fits) = match limits.and_then(|limits| Some((limits, value.as_f64()?))) {
            Some(([least, _], found)) if found < least => (limit(&value, least), false),
            Some(([_, most], found)) if found > most => (limit(&value, most), false),
            _ => (value, true),
        };
        self.values[index] = value;
        fits
    }

    /// The value at `now` with the effects of faults.
    pub(crate) fn read(&self, index: usize, now: Instant, world: &World) -> Value {
        if self.overlays.is_empty() {
            return match self.known[index].source {
                Source::Stored => self.values[index].clone(),
                _ => self.sound(index, now, world),
            };
        }
        let mut value = self.sound(index, now, world);
        for overlay in self
            .overlays
            .iter()
            .filter(|overlay| overlay.variable == index)
        {
            value = match &overlay.change {
                Change::Frozen(value) => value.clone(),
                Change::Factor(factor) => match &value {
                    Value::Int(_) => {
                        let changed = value.as_f64().unwrap_or(0.0) * factor;
                        Value::Int(Value::Float(changed).as_int().unwrap_or(0))
                    }
                    Value::Float(float) => Value::Float(float * factor),
                    other => other.clone(),
                },
                Change::Computed { expr, figure } => {
                    // A fault reads the values without faults: this prevents circular dependencies.
                    let mut plain = self.clone();
                    plain.overlays.clear();
                    let reading = Reading {
                        state: &plain,
                        now,
                        world,
                    };
                    let scope = Faulty {
                        reading,
                        value: &value,
                        figure: *figure,
                    };
                    expr.eval(&scope).unwrap_or_else(|_| value.clone())
                }
            };
        }
        value
    }

    /// Like [`read`](Self::read), without a copy of a stored value.
    pub(crate) fn look(&self, index: usize, now: Instant, world: &World) -> Cow<'_, Value> {
        match self.known[index].source {
            Source::Stored if self.overlays.is_empty() => Cow::Borrowed(&self.values[index]),
            _ => Cow::Owned(self.read(index, now, world)),
        }
    }

    fn sound(&self, index: usize, now: Instant, world: &World) -> Value {
        let variable = &self.known[index];
        let elapsed = now - self.began;
        let periods = |period: Duration| periods(elapsed, period);
        let phase = |period: Duration| {
            let period = period.as_nanos().max(1);
            #[expect(clippy::cast_precision_loss, reason = "a share of a period")]
            let share = (elapsed.as_nanos() % period) as f64 / period as f64;
            share
        };
        match &variable.source {
            Source::Stored => self.values[index].clone(),
            Source::Counter(period) => {
                let counts = i128::try_from(periods(*period)).unwrap_or(i128::MAX);
                let first = self.values[index].as_int().unwrap_or(0);
                Value::Int(first.saturating_add(counts))
            }
            Source::Ramp { from, to, period } => Value::Float(from + (to - from) * phase(*period)),
            Source::Sine {
                mean,
                amplitude,
                period,
            } => Value::Float(mean + amplitude * libm::sin(TAU * phase(*period))),
            Source::Noise {
                mean,
                deviation,
                period,
            } => {
                // Each period has its own random stream, so that the number of reads does not
                // matter.
                let name = format!("{}.{}.{}", self.name, variable.name, periods(*period));
                let draw = Rng::stream(self.seed, &name).gauss();
                Value::Float(mean + deviation * draw)
            }
            Source::Recorded { recording, repeats } => {
                Value::Float(recording.at(elapsed.as_secs_f64(), *repeats))
            }
            Source::World(quantity) => of_world(*quantity, world),
            Source::Computed(expr) => {
                let reading = Reading {
                    state: self,
                    now,
                    world,
                };
                expr.eval(&reading).unwrap_or(Value::Int(0))
            }
        }
    }
}

/// The number of whole periods in a time.
fn periods(elapsed: Duration, period: Duration) -> u128 {
    let (elapsed, period) = (elapsed.as_nanos(), period.as_nanos().max(1));
    // A division of 64 bits costs a fraction of one of 128 bits; 64 bits are 584 years.
    match (u64::try_from(elapsed), u64::try_from(period)) {
        (Ok(elapsed), Ok(period)) => (elapsed / period).into(),
        _ => elapsed / period,
    }
}

/// A limit as a value of the same kind.
fn limit(value: &Value, limit: f64) -> Value {
    match value {
        Value::Float(_) => Value::Float(limit),
        _ => Value::Int(Value::Float(limit).as_int().unwrap_or(0)),
    }
}

fn of_world(quantity: WorldQuantity, world: &World) -> Value {
    let pose = world.pose();
    match quantity {
        WorldQuantity::XM => Value::Float(pose.x),
        WorldQuantity::YM => Value::Float(pose.y),
        WorldQuantity::HeadingDeg => Value::Float(pose.theta.to_degrees()),
        WorldQuantity::SpeedMS => Value::Float(world.speed()),
        WorldQuantity::TurnRateDegS => Value::Float(world.turn_rate().to_degrees()),
        WorldQuantity::RangeM => {
            let hit = world.cast_ray(pose.point(), pose.theta, RANGE_MAX_M);
            Value::Float(hit.map_or(RANGE_MAX_M, |hit| hit.distance))
        }
        WorldQuantity::Contacts => Value::Int(world.contact_count().into()),
    }
}
