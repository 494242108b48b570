//! A run as data: world, robot, devices, faults, mission, expectations. One TOML file with a
//! closed schema: a key that nobody reads is an error, not a silent wish.

mod span;
pub mod world;

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use emulators::rng::Rng;
use protocols::Instant;
use serde::{Deserialize, Serialize};

use crate::fault::{Damage, DamageKind, LineFaults, Strike, Window};
use crate::line::Direction;
pub use span::Span;
pub use world::WorldSpec;

/// The only schema so far. Later versions go on reading it.
pub const SCHEMA: u32 = 1;

/// A run as data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Version of the format, 1.
    #[serde(deserialize_with = "known_schema")]
    pub schema: u32,
    /// Short name, used for files and reports.
    #[serde(deserialize_with = "file_name")]
    pub name: String,
    /// What it is about, for people.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Which robot.
    pub robot: Robot,
    /// How long at most.
    pub duration: Span,
    /// Seed of all randomness; the command line may replace it.
    #[serde(default = "default_seed", deserialize_with = "seed")]
    pub seed: u64,
    /// Where a saved case comes from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<Origin>,
    /// What the robot has to do.
    #[serde(default)]
    pub mission: Mission,
    /// What must have come true in the end.
    #[serde(default)]
    pub expect: Expect,
    /// The robot's program.
    #[serde(default)]
    pub program: ProgramSpec,
    /// Settings of devices, by the names that the robot gives them.
    #[serde(default)]
    pub device: BTreeMap<String, DeviceSpec>,
    /// Settings of links, by the names that the robot gives them.
    #[serde(default)]
    pub link: BTreeMap<String, LinkSpec>,
    /// Ground truth.
    pub world: WorldSpec,
    /// What goes wrong.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fault: Vec<FaultSpec>,
}

/// The robots that can be wired.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Robot {
    /// XV-11 lidar, AVR base, HC-06 radio; tinySLAM.
    Rescue,
}

/// Where a saved case comes from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Tool and version that wrote it.
    pub tool: String,
    /// Fingerprint of all bytes of the run that it was saved from.
    pub trace_hash: String,
}

/// What the robot has to do.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mission {
    /// Places to visit in this order, metres in the world's frame; the last is where the robot has
    /// to be in the end. Sent by the PC once it is connected.
    #[serde(default)]
    pub waypoints_m: Vec<[f64; 2]>,
    /// When the PC connects to the radio.
    #[serde(default = "default_connect")]
    pub connect: Span,
    /// What else the PC does, at given times.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub step: Vec<Step>,
}

/// Something that the PC does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// When.
    pub at: Span,
    /// What.
    #[serde(rename = "do")]
    pub action: Action,
}

/// What the PC can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Action {
    /// Connects to the radio.
    Connect,
    /// Disconnects.
    Disconnect,
    /// Replaces the robot's list of waypoints, metres in the world's frame.
    WaypointsM(Vec<[f64; 2]>),
    /// Orders a mode.
    Mode(ModeSpec),
    /// Orders manual mode with these set-points, left and right, in ticks per 40 ms.
    Drive([i8; 2]),
}

/// Modes that can be ordered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ModeSpec {
    /// Motors off.
    Stop,
    /// Drive by itself.
    Exploration,
    /// Visit the waypoints.
    Waypoint,
}

/// What must have come true in the end; what is not given is not demanded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// Each waypoint is visited in order, at most this far off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visit_within_mm: Option<f64>,
    /// In the end the robot rests at the last waypoint, at most this far off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub return_within_mm: Option<f64>,
    /// Root mean square of the error of the believed position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_rms_mm_max: Option<f64>,
    /// Root mean square of the error of the believed heading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading_rms_deg_max: Option<f64>,
    /// Share of walls found, and of found walls that are there, within one cell; the smaller one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wall_overlap_min: Option<f64>,
    /// Rules of devices that the program broke.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub violations_max: Option<u64>,
    /// The PC has received every row of the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_received: Option<bool>,
}

/// Settings of the robot's program.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProgramSpec {
    /// What it does before it is told anything.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_mode: Option<ModeSpec>,
    /// Which algorithm maps.
    #[serde(default)]
    pub mapper: MapperSpec,
    /// Which processor runs it.
    #[serde(default)]
    pub cpu: CpuSpec,
}

/// Mapping algorithms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MapperSpec {
    /// The best that the program has.
    #[default]
    Best,
    /// As the seed document describes it.
    Document,
}

/// Processors whose speed is modelled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CpuSpec {
    /// 168 MHz Cortex-M4, prices from the seed document.
    #[default]
    Stm32f4,
    /// Never busy.
    Ideal,
}

/// Settings of a device, named by its kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum DeviceSpec {
    /// Neato XV-11 lidar.
    Xv11(Xv11Spec),
    /// AVR base with its register bus.
    AvrBase(AvrBaseSpec),
    /// HC-06 radio.
    Hc06(Hc06Spec),
}

impl DeviceSpec {
    /// Name of the kind, as in a file.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Xv11(_) => "xv11",
            Self::AvrBase(_) => "avr-base",
            Self::Hc06(_) => "hc06",
        }
    }
}

/// Settings of an XV-11.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Xv11Spec {
    /// Firmware: `fw2.1`, `fw2.4.13386`, `fw2.6.15295`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<toml::Spanned<String>>,
    /// What turns the head; 300 rpm held by the rig if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub supply: Option<SupplySpec>,
}

/// What turns the head of a lidar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SupplySpec {
    /// The rig holds this speed, turns per minute.
    RegulatedRpm(f64),
    /// A fixed voltage.
    FixedV(f64),
    /// The host's drive, this voltage at full duty.
    HostV(f64),
}

impl From<SupplySpec> for emulators::xv11::MotorSupply {
    fn from(spec: SupplySpec) -> Self {
        match spec {
            SupplySpec::RegulatedRpm(rpm) => Self::Regulated { rpm },
            SupplySpec::FixedV(volts) => Self::Fixed { volts },
            SupplySpec::HostV(volts) => Self::Host { volts },
        }
    }
}

/// Settings of an AVR base.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AvrBaseSpec {
    /// Firmware: `document`, `rcj2015-2015`, `rcj2015-2014`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<toml::Spanned<String>>,
}

/// Settings of an HC-06.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hc06Spec {
    /// Firmware: `linvor-1.8`, `hc01-2.0`, `3.0-20170609`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<toml::Spanned<String>>,
    /// Rate of the wire to the microcontroller; the robot's own rate if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// Time from the PC opening its port to the first byte passing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub connect_delay: Option<Span>,
}

/// Settings of a link.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkSpec {
    /// Time between the last bit on the wire and the receiver seeing the byte, both ways.
    #[serde(default)]
    pub latency: Span,
}

/// Something that goes wrong on a link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultSpec {
    /// Which link.
    pub link: toml::Spanned<String>,
    /// Which way.
    pub direction: DirectionSpec,
    /// What happens.
    pub kind: FaultKind,
    /// Chance per byte, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<toml::Spanned<f64>>,
    /// Number of the one byte that is hit, counted from 0 as sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub byte: Option<u64>,
    /// For `flip`: which bit, 0 to 7.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bit: Option<u8>,
    /// For `insert`: which value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<u8>,
    /// Begins here instead of at the start of the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<Span>,
    /// Ends here instead of at the end of the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<Span>,
}

impl FaultSpec {
    /// The fault that does once more what `strike` did.
    pub fn of_strike(link: &str, direction: DirectionSpec, strike: Strike) -> Self {
        let (kind, bit, value) = match strike.damage {
            Damage::Flip { bit } => (FaultKind::Flip, Some(bit), None),
            Damage::Drop => (FaultKind::Drop, None, None),
            Damage::Insert { value } => (FaultKind::Insert, None, Some(value)),
            Damage::Duplicate => (FaultKind::Duplicate, None, None),
        };
        let link = toml::Spanned::new(0..0, link.to_owned());
        let byte = Some(strike.byte);
        Self {
            link,
            direction,
            kind,
            rate: None,
            byte,
            bit,
            value,
            from: None,
            until: None,
        }
    }

    /// Plans the fault on `line`; `index` is its place in the scenario's list.
    pub fn plan(
        &self,
        index: usize,
        line: &mut LineFaults,
        seed: u64,
        source: &Source,
    ) -> Result<(), ScenarioError> {
        let invalid = |key: &str, message: &str| {
            let key = format!("fault[{index}].{key}");
            Err(source.invalid(Some(self.link.span()), key, message))
        };
        let window = Window {
            from: self.from.map_or(Instant::ZERO, Span::instant),
            until: self.until.map_or(Window::ALWAYS.until, Span::instant),
        };
        let Some(kind) = self.kind.damage() else {
            line.add_cut(window);
            return Ok(());
        };
        match (&self.rate, self.byte) {
            (Some(rate), None) if (0.0..=1.0).contains(rate.get_ref()) => {
                let stream = format!("fault.{index}");
                line.add_rate(kind, window, *rate.get_ref(), Rng::stream(seed, &stream));
                Ok(())
            }
            (Some(_), None) => invalid("rate", "expected a chance per byte from 0 to 1"),
            (None, Some(byte)) => {
                let damage = match (self.kind, self.bit, self.value) {
                    (FaultKind::Flip, Some(bit @ 0..8), None) => Damage::Flip { bit },
                    (FaultKind::Flip, ..) => {
                        return invalid("bit", "a flip of one byte needs its bit, 0 to 7");
                    }
                    (FaultKind::Insert, None, Some(value)) => Damage::Insert { value },
                    (FaultKind::Insert, ..) => {
                        return invalid("value", "an insertion at one byte needs its value");
                    }
                    (FaultKind::Duplicate, ..) => Damage::Duplicate,
                    (FaultKind::Drop | FaultKind::Cut, ..) => Damage::Drop,
                };
                line.add_strike(Strike { byte, damage });
                Ok(())
            }
            _ => invalid("rate", "expected either a rate or the number of a byte"),
        }
    }
}

/// Directions as in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DirectionSpec {
    /// From the device to the robot's program.
    ToMaster,
    /// From the robot's program to the device.
    ToDevice,
}

impl From<DirectionSpec> for Direction {
    fn from(spec: DirectionSpec) -> Self {
        match spec {
            DirectionSpec::ToMaster => Self::ToMaster,
            DirectionSpec::ToDevice => Self::ToDevice,
        }
    }
}

/// Kinds of faults as in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultKind {
    /// A bit is inverted.
    Flip,
    /// A byte is lost.
    Drop,
    /// A byte is inserted before another.
    Insert,
    /// A byte comes twice.
    Duplicate,
    /// Nothing gets through.
    Cut,
}

impl FaultKind {
    /// What it does to a byte; `None` for a cut.
    pub const fn damage(self) -> Option<DamageKind> {
        match self {
            Self::Flip => Some(DamageKind::Flip),
            Self::Drop => Some(DamageKind::Drop),
            Self::Insert => Some(DamageKind::Insert),
            Self::Duplicate => Some(DamageKind::Duplicate),
            Self::Cut => None,
        }
    }
}

const fn default_seed() -> u64 {
    1
}

fn default_connect() -> Span {
    Span::from_millis(500)
}

fn known_schema<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    match u32::deserialize(deserializer)? {
        SCHEMA => Ok(SCHEMA),
        other => Err(serde::de::Error::custom(format!(
            "schema is {other}, expected {SCHEMA}"
        ))),
    }
}

fn seed<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
    let seed = i64::deserialize(deserializer)?;
    let expected = "expected a seed from 0 to 9223372036854775807";
    u64::try_from(seed).map_err(|_| serde::de::Error::custom(format!("seed is {seed}, {expected}")))
}

fn file_name<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let name = String::deserialize(deserializer)?;
    let fits = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if name.is_empty() || name.starts_with('.') || !name.chars().all(fits) {
        let expected = "expected letters, digits, '-', '_' and '.'";
        return Err(serde::de::Error::custom(format!(
            "name is \"{name}\", {expected}"
        )));
    }
    Ok(name)
}

/// Why a scenario cannot be run.
#[derive(Debug)]
pub enum ScenarioError {
    /// The file cannot be read.
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not a scenario; the text names line, column, key and what was expected.
    Parse {
        /// Which file.
        path: PathBuf,
        /// What is wrong, with the line shown.
        source: Box<toml::de::Error>,
    },
    /// The scenario says something that cannot be.
    Invalid {
        /// Which file.
        path: PathBuf,
        /// Line, from 1, if known.
        line: Option<usize>,
        /// Key in question, e.g. `world.wall[3]`.
        key: String,
        /// What is wrong and what was expected.
        message: String,
    },
}

impl fmt::Display for ScenarioError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read { path, source } => {
                write!(f, "cannot read scenario {}: {source}", path.display())
            }
            Self::Parse { path, source } => {
                write!(f, "{}: {}", path.display(), source.to_string().trim_end())
            }
            Self::Invalid {
                path,
                line,
                key,
                message,
            } => {
                write!(f, "{}", path.display())?;
                if let Some(line) = line {
                    write!(f, ":{line}")?;
                }
                write!(f, ": {key}: {message}")
            }
        }
    }
}

impl std::error::Error for ScenarioError {}

/// A scenario with the place it was read from, for messages and for files that it names.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file, or a name in angle brackets for a built-in scenario.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
}

impl Source {
    /// Where `name` stands as a table header or key, for messages.
    pub fn find(&self, name: &str) -> Option<core::ops::Range<usize>> {
        let start = self
            .text
            .find(&format!(".{name}"))
            .or_else(|| self.text.find(name))?;
        Some(start..start + name.len())
    }

    /// The error that `key`, whose value lies at `span` of the text, is wrong.
    pub fn invalid(
        &self,
        span: Option<core::ops::Range<usize>>,
        key: impl Into<String>,
        message: impl Into<String>,
    ) -> ScenarioError {
        let line = span
            .filter(|span| span.end > 0 && span.start <= self.text.len())
            .map(|span| {
                1 + self.text.as_bytes()[..span.start]
                    .iter()
                    .filter(|&&b| b == b'\n')
                    .count()
            });
        ScenarioError::Invalid {
            path: self.path.clone(),
            line,
            key: key.into(),
            message: message.into(),
        }
    }
}

impl Scenario {
    /// Reads a scenario file.
    pub fn read(path: &Path) -> Result<(Self, Source), ScenarioError> {
        let text = std::fs::read_to_string(path).map_err(|source| ScenarioError::Read {
            path: path.to_owned(),
            source,
        })?;
        Self::parse(path, text)
    }

    /// Reads a scenario from `text`; `path` is for messages and relative files.
    pub fn parse(path: &Path, text: String) -> Result<(Self, Source), ScenarioError> {
        match toml::from_str(&text) {
            Ok(scenario) => Ok((
                scenario,
                Source {
                    path: path.to_owned(),
                    text,
                },
            )),
            Err(source) => Err(ScenarioError::Parse {
                path: path.to_owned(),
                source: Box::new(source),
            }),
        }
    }

    /// The scenario as a file.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("every field has a TOML form")
    }
}
