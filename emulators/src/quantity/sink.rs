//! Effect of a value on the world, and its requirements on the chassis.

use crate::world::{Chassis, Command};

/// Effect of a variable on the world: its value times `scale` goes to an actuator whenever the
/// value changes, by a master's write or by the timeout of a silent master. At the start of the run
/// a value of 0 changes nothing, so that brakes stay on. The device's first poll passes on any
/// other value.
#[derive(Clone, Debug, PartialEq)]
pub struct Sink {
    /// Name of the actuator.
    pub actuator: String,
    /// Units of the actuator per count of the value: drive, m/s or rad, as `kind` says.
    pub scale: f64,
    /// Kind of the actuator's command.
    pub kind: SinkKind,
}

/// Command that a [`Sink`] sends to its actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SinkKind {
    /// [`Command::Power`]: -255 to 255.
    Power,
    /// [`Command::Speed`]: m/s.
    Speed,
    /// [`Command::Angle`]: rad.
    Angle,
}

impl Sink {
    /// Command of the actuator for `value`.
    pub fn command(&self, value: i64) -> Command {
        #[expect(
            clippy::cast_precision_loss,
            reason = "rounding beyond 2^53 is harmless"
        )]
        let value = value as f64;
        self.command_of(value)
    }

    /// Converts a value with a fraction to a command.
    pub fn command_of(&self, value: f64) -> Command {
        let figure = value * self.scale;
        match self.kind {
            #[expect(clippy::cast_possible_truncation, reason = "at most 255")]
            SinkKind::Power => Command::Power(figure.clamp(-255.0, 255.0).round() as i16),
            SinkKind::Speed => Command::Speed(figure),
            SinkKind::Angle => Command::Angle(figure),
        }
    }
}

/// A name that a device expects the chassis to have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted<'a> {
    /// An actuator that takes the commands of this sink.
    Actuator(&'a Sink),
    /// An encoder.
    Encoder(&'a str),
}

impl Wanted<'_> {
    /// Reason why `chassis` lacks it, in a sentence; `None` if it has it.
    pub fn missing(&self, chassis: &dyn Chassis) -> Option<String> {
        match self {
            Self::Actuator(sink) => {
                let known = chassis.actuators();
                let Some(actuator) = known.iter().find(|known| known.name == sink.actuator) else {
                    let names = known.iter().map(|known| known.name.as_str());
                    return Some(missing("actuator", &sink.actuator, names));
                };
                let refused = actuator.admit(sink.command(0)).err();
                refused.map(|error| error.to_string())
            }
            Self::Encoder(name) => {
                let known = chassis.encoders();
                let names = known.iter().map(|known| known.name.as_str());
                let is_there = known.iter().any(|known| known.name == *name);
                (!is_there).then(|| missing("encoder", name, names))
            }
        }
    }
}

fn missing<'a>(what: &str, wanted: &str, known: impl Iterator<Item = &'a str>) -> String {
    let known: Vec<_> = known.collect();
    let known = known.join(", ");
    format!("there is no {what} \"{wanted}\", expected one of: {known}")
}
