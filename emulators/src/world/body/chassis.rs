//! The world's interface to a drive train, for any kind of wheels.

use core::fmt;

use super::footprint::Footprint;
use super::{BodyConfig, Drive};

/// A drive train as physics sees it: actuators in, motion over the floor and encoder counts out.
///
/// The world owns the time. It calls [`begin_step`](Self::begin_step) once for each step of 1 ms,
/// for 0, 1, 2 and so on, in order; the returned motion holds for the whole step. Between two such
/// calls the world may call the other methods any number of times, in any order. Only
/// [`actuate`](Self::actuate) changes the future, from the next step on. The last call before a
/// step counts, and a repeated command has no further effect.
///
/// Footprint, actuators and encoders are the same lists in the same order for the whole life of the
/// chassis; indices refer to these lists. No index beyond its list is ever passed.
///
/// Equal chassis behave alike forever, and a clone continues as its original does. A chassis uses
/// no clock, and no chance except its own [named streams](crate::rng), drawn per step whatever the
/// robot does. It need not know walls: the world keeps the body out of them, and the wheels slip
/// meanwhile.
pub trait Chassis: fmt::Debug + Send + Sync {
    /// Colliding shape around the reference point: the point whose motion `begin_step` returns.
    fn footprint(&self) -> &Footprint;

    /// The actuators. Names differ. A world's [`set_drive`](crate::world::World::set_drive) means
    /// the motors named `left` and `right`.
    fn actuators(&self) -> &[Actuator];

    /// Sets an actuator from the next step on. The world passes only commands that
    /// [`Actuator::admit`] accepted; ignore the rest.
    fn actuate(&mut self, actuator: usize, command: Command);

    /// Last command of an actuator, or its command at the start.
    fn command(&self, actuator: usize) -> Command;

    /// True value of an actuator in this step, in the unit of its kind.
    fn actual(&self, actuator: usize) -> f64;

    /// Begins step `number`. Both figures must be finite; a speed of more than 5 m/s or a turn rate
    /// of more than 20 rad/s may carry the body through thin obstacles.
    fn begin_step(&mut self, number: u64) -> Velocity;

    /// Its encoders. Their names are unique.
    fn encoders(&self) -> &[Encoder];

    /// Counts of an encoder since the start of the run, `after_s` seconds (0 to 0.001) into the
    /// step begun last; forward counts up.
    fn count(&self, encoder: usize, after_s: f64) -> i64;

    /// Speed in this step of the axis that an encoder sits on, as metres of rim per second.
    fn axis_speed(&self, encoder: usize) -> f64;

    /// A copy of the chassis.
    fn clone_box(&self) -> Box<dyn Chassis>;

    /// The figures of a differential drive; `None` for any other chassis, whose
    /// [`World::body`](crate::world::World::body) is then a stand-in. To be removed with that
    /// method.
    fn body(&self) -> Option<&BodyConfig> {
        None
    }
}

impl Clone for Box<dyn Chassis> {
    fn clone(&self) -> Self {
        (**self).clone_box()
    }
}

/// Motion of the reference point over the floor, in body axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Velocity {
    /// Forward, m/s.
    pub speed_m_s: f64,
    /// Counter-clockwise, rad/s.
    pub turn_rad_s: f64,
}

/// An actuator: a part of a chassis that takes commands.
#[derive(Clone, Debug, PartialEq)]
pub struct Actuator {
    /// Stable name in snake case, unique in its chassis.
    pub name: String,
    /// Its kind.
    pub kind: ActuatorKind,
    /// Minimum and maximum value in the unit of its kind; a value beyond them becomes the nearer
    /// one.
    pub range: [f64; 2],
}

/// Kind of an actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ActuatorKind {
    /// Turns a wheel behind a driver that can brake and coast; m/s of rim.
    Motor,
    /// Turns the steered wheels; rad, counter-clockwise from straight ahead.
    Steering,
}

impl ActuatorKind {
    /// Unit of range and actual value.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Motor => "m/s",
            Self::Steering => "rad",
        }
    }

    /// Whether an actuator of this kind accepts `command`.
    pub const fn takes(self, command: Command) -> bool {
        match command {
            Command::Power(_) | Command::Brake | Command::Coast | Command::Speed(_) => {
                matches!(self, Self::Motor)
            }
            Command::Angle(_) => matches!(self, Self::Steering),
        }
    }
}

impl fmt::Display for ActuatorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Motor => "motor",
            Self::Steering => "steering",
        })
    }
}

impl Actuator {
    /// Brings `command` into range; an error if this actuator does not accept it.
    ///
    /// # Errors
    /// [`CommandError::Unfit`] and [`CommandError::NotFinite`].
    pub fn admit(&self, command: Command) -> Result<Command, CommandError> {
        let kind = self.kind;
        if !kind.takes(command) {
            return Err(CommandError::Unfit {
                actuator: self.name.clone(),
                kind,
                command,
            });
        }
        let [least, greatest] = self.range;
        let within = |value: f64| value.max(least).min(greatest);
        match command {
            Command::Speed(value) | Command::Angle(value) if !value.is_finite() => {
                Err(CommandError::NotFinite {
                    actuator: self.name.clone(),
                })
            }
            Command::Speed(value) => Ok(Command::Speed(within(value))),
            Command::Angle(value) => Ok(Command::Angle(within(value))),
            Command::Power(_) | Command::Brake | Command::Coast => Ok(command),
        }
    }
}

/// Command of an actuator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Command {
    /// As [`Drive::Power`].
    Power(i16),
    /// As [`Drive::Brake`].
    #[default]
    Brake,
    /// As [`Drive::Coast`].
    Coast,
    /// An ideal regulator holds this speed of the rim, m/s. It is reached with the lag of a driven
    /// wheel, and limited to the speed at full drive.
    Speed(f64),
    /// The servo goes to this angle, rad, counter-clockwise from straight ahead.
    Angle(f64),
}

impl Command {
    /// The drive with the same effect, or with the same part of full drive.
    pub(in crate::world) fn as_drive(self, full_speed_m_s: f64) -> Drive {
        match self {
            Self::Power(power) => Drive::Power(power),
            Self::Speed(speed) if full_speed_m_s > 0.0 => {
                #[expect(clippy::cast_possible_truncation, reason = "at most 255")]
                let power = (255.0 * (speed / full_speed_m_s).clamp(-1.0, 1.0)).round() as i16;
                Drive::Power(power)
            }
            Self::Coast => Drive::Coast,
            Self::Brake | Self::Speed(_) | Self::Angle(_) => Drive::Brake,
        }
    }
}

impl From<Drive> for Command {
    fn from(drive: Drive) -> Self {
        match drive {
            Drive::Power(power) => Self::Power(power),
            Drive::Brake => Self::Brake,
            Drive::Coast => Self::Coast,
        }
    }
}

/// An encoder: it counts the turn of an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoder {
    /// Stable name in snake case, unique in its chassis.
    pub name: String,
    /// Counts per metre of the rim.
    pub counts_per_m: f64,
}

/// One of a list of actuators or encoders, by name or by index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Select<'a> {
    /// The index, from 0.
    Index(usize),
    /// The name.
    Name(&'a str),
}

impl Select<'_> {
    /// Index in a list of these names, if it is in the list.
    pub fn find<'n>(self, mut names: impl ExactSizeIterator<Item = &'n str>) -> Option<usize> {
        match self {
            Self::Index(index) => (index < names.len()).then_some(index),
            Self::Name(wanted) => names.position(|name| name == wanted),
        }
    }
}

impl From<usize> for Select<'_> {
    fn from(index: usize) -> Self {
        Self::Index(index)
    }
}

impl<'a> From<&'a str> for Select<'a> {
    fn from(name: &'a str) -> Self {
        Self::Name(name)
    }
}

impl<'a> From<&'a String> for Select<'a> {
    fn from(name: &'a String) -> Self {
        Self::Name(name)
    }
}

impl fmt::Display for Select<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Index(index) => write!(f, "number {index}"),
            Self::Name(name) => write!(f, "\"{name}\""),
        }
    }
}

/// Reason why a command has no effect.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum CommandError {
    /// The chassis has no such actuator.
    UnknownActuator {
        /// The requested name.
        wanted: String,
        /// The existing names.
        known: Vec<String>,
    },
    /// The actuator cannot do that.
    Unfit {
        /// Name of the actuator.
        actuator: String,
        /// A short description.
        kind: ActuatorKind,
        /// The refused command.
        command: Command,
    },
    /// The figure is NaN or infinite.
    NotFinite {
        /// Name of the actuator.
        actuator: String,
    },
}

impl fmt::Display for CommandError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownActuator { wanted, known } => {
                let known = known.join(", ");
                write!(f, "there is no actuator {wanted}; expected one of: {known}")
            }
            Self::Unfit {
                actuator,
                kind,
                command,
            } => {
                let follows = match kind {
                    ActuatorKind::Motor => "power or speed_m_s",
                    ActuatorKind::Steering => "angle_deg",
                };
                let given = match command {
                    Command::Power(_) => "a power",
                    Command::Speed(_) => "a speed",
                    Command::Angle(_) => "an angle",
                    Command::Brake | Command::Coast => "a brake",
                };
                write!(
                    f,
                    "{actuator} is a {kind} and cannot follow {given}, expected {follows}"
                )
            }
            Self::NotFinite { actuator } => {
                write!(f, "{actuator} was given a value that is not finite")
            }
        }
    }
}

impl core::error::Error for CommandError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_a_list_is_found_by_its_place_or_its_name() {
        let find = |select: Select<'_>| select.find(["left", "right"].into_iter());
        let places = [0, 1, 2].map(|index| find(Select::from(index)));
        assert_eq!(places, [Some(0), Some(1), None]);
        let names = ["left", "right", "middle"].map(|name| find(Select::from(name)));
        assert_eq!(names, [Some(0), Some(1), None]);
    }

    /// Half of full speed is 127.5 of 255, which is rounded to 128; a motor without speed, and a
    /// servo, brake.
    #[test]
    fn a_speed_is_a_part_of_full_drive() {
        let drive = |speed, full| Command::Speed(speed).as_drive(full);
        let powers = [0.175, -0.35, 0.7, -9.0, 0.0].map(|speed| drive(speed, 0.35));
        assert_eq!(powers, [128, -255, 255, -255, 0].map(Drive::Power));
        assert_eq!(drive(1.0, 2.0), Drive::Power(128));
        assert_eq!(drive(1.0, 0.0), Drive::Brake);
        assert_eq!(Command::Angle(1.0).as_drive(1.0), Drive::Brake);
        for drive in [Drive::Power(-7), Drive::Coast, Drive::Brake] {
            assert_eq!(Command::from(drive).as_drive(0.35), drive);
        }
    }

    #[test]
    fn what_an_actuator_cannot_do_is_told() {
        let shown = [Select::Index(3), Select::Name("left")].map(|select| select.to_string());
        assert_eq!(shown, ["number 3", "\"left\""]);
        let steering = Actuator {
            name: "steering".to_owned(),
            kind: ActuatorKind::Steering,
            range: [-0.5, 0.25],
        };
        let motor = Actuator {
            name: "drive".to_owned(),
            kind: ActuatorKind::Motor,
            ..steering.clone()
        };
        let told = |actuator: &Actuator, command| {
            let refused = actuator.admit(command).expect_err("it cannot");
            refused.to_string()
        };
        let cannot = "steering is a steering and cannot follow";
        for (command, given) in [
            (Command::Power(7), "a power"),
            (Command::Speed(0.1), "a speed"),
            (Command::Brake, "a brake"),
            (Command::Coast, "a brake"),
        ] {
            let expected = format!("{cannot} {given}, expected angle_deg");
            assert_eq!(told(&steering, command), expected);
        }
        assert_eq!(
            told(&motor, Command::Angle(0.1)),
            "drive is a motor and cannot follow an angle, expected power or speed_m_s"
        );
        let not_finite = "steering was given a value that is not finite";
        assert_eq!(told(&steering, Command::Angle(f64::NAN)), not_finite);
        assert_eq!(
            told(&motor, Command::Speed(f64::INFINITY)),
            "drive was given a value that is not finite"
        );
        let admitted = [-9.0, -0.5, 0.1, 9.0].map(|angle| steering.admit(Command::Angle(angle)));
        let expected = [-0.5, -0.5, 0.1, 0.25].map(|angle| Ok(Command::Angle(angle)));
        assert_eq!(admitted, expected);
        assert_eq!(motor.admit(Command::Speed(1.0)), Ok(Command::Speed(0.25)));
        assert_eq!(motor.admit(Command::Brake), Ok(Command::Brake));
        let units = [ActuatorKind::Motor, ActuatorKind::Steering].map(ActuatorKind::unit);
        assert_eq!(units, ["m/s", "rad"]);
    }
}
