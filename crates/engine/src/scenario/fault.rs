//! Settings of links, and faults.

mod catalogue;
mod json;
mod keys;
mod kind;
mod plan;
mod schedule;
mod when;

use protocols::Instant;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Condition, Span};
use crate::rig::fault::{Damage, Strike, Window};
use crate::rig::line::Direction;

pub use catalogue::catalogue;
pub use kind::{FaultKind, FaultPlace};
pub use when::{RegisterName, WhenSpec};

/// Settings of a link.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LinkSpec {
    /// Time from the last bit of a byte on the wire to its arrival at the receiver, in both
    /// directions.
    #[serde(default)]
    pub latency: Span,
    /// USB adapter at the client's end of the link: it groups and splits the bytes that a client
    /// reads, also in virtual time (`--virtual`); it has no effect on a robot's own program.
    #[serde(default, skip_serializing_if = "AdapterSpec::is_direct")]
    pub adapter: AdapterSpec,
}

/// An adapter between a UART and its client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AdapterSpec {
    /// No adapter: bytes arrive as the device sends them.
    #[default]
    Direct,
    /// Up to 62 bytes every 16 ms.
    Ftdi,
    /// Up to 64 bytes every 4 ms.
    Cp2102,
    /// Up to 32 bytes every millisecond.
    Ch340,
}

impl AdapterSpec {
    /// Whether there is none.
    pub fn is_direct(&self) -> bool {
        *self == Self::Direct
    }
}

/// Declares the keys of a fault: each is optional, and the given ones can be listed.
macro_rules! fault_spec {
    ($($(#[doc = $doc:literal])+ $key:ident: $type:ty $(, $least:literal to $most:literal)?;)+) => {
        /// A fault. Its kind decides which keys it has.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        #[schemars(transform = keys::add_to_schema)]
        pub struct FaultSpec {
            /// Kind of the fault.
            pub kind: FaultKind,
            $(
                $(#[doc = $doc])+
                $(#[schemars(range(min = $least, max = $most))])?
                #[serde(default, skip_serializing_if = "Option::is_none")]
                pub $key: Option<$type>,
            )+
        }

        impl FaultSpec {
            /// A fault of `kind` without any keys.
            pub const fn new(kind: FaultKind) -> Self {
                Self { kind, $($key: None,)+ }
            }

            /// The keys that are given.
            fn given(&self) -> impl Iterator<Item = &'static str> {
                let keys = [$((stringify!($key), self.$key.is_some())),+];
                keys.into_iter().filter_map(|(key, given)| given.then_some(key))
            }
        }
    };
}

fault_spec! {
    /// Name of the link.
    link: String;
    /// Direction.
    direction: DirectionSpec;
    /// Name of the device.
    device: String;
    /// Names of the devices.
    devices: Vec<String>;
    /// Probability per byte, or per message of an I2C or datagram link, 0 to 1.
    rate: f64, 0.0 to 1.0;
    /// Number of the damaged byte or message, counted from 0 in the order sent.
    byte: u64;
    /// For `flip`: number of the bit, 0 to 7.
    bit: u8, 0 to 7;
    /// For `insert`: the inserted value; for `burst`: the inverted bits; 0 to 255.
    value: u8;
    /// Number of bytes, 1 to 65535; 4 for `burst`, 4096 for `truncate`, 1 for `short-read` if not
    /// given.
    len: u16, 1 to 65_535;
    /// Size of the receiver's buffer, bytes, 0 to 65535; 2 if not given.
    fifo: u16;
    /// Delay, at most an hour.
    by: Span;
    /// Rate of the sender, bit/s, 50 to 50000000.
    baud: u32, 50 to 50_000_000;
    /// Millionths by which the sender is too fast, -1000000 to 1000000.
    ppm: f64, -1_000_000.0 to 1_000_000.0;
    /// Increase of `ppm` per second, -1000000 to 1000000.
    ppm_per_s: f64, -1_000_000.0 to 1_000_000.0;
    /// Name of the other link.
    with: String;
    /// For `unplugged`: name of the client's port after the fault; the old name if not given.
    back_as: String;
    /// Name of the device's own fault.
    fault: String;
    /// Factor or amount, -1000000 to 1000000.
    factor: f64, -1_000_000.0 to 1_000_000.0;
    /// Start of the fault; the start of the run if not given.
    from: Span;
    /// End of the fault; the end of the run if not given.
    until: Span;
    /// Duration of the fault, in place of `until`; with `every`, duration of each repetition.
    lasting: Span;
    /// Period of repetition, at least 100us.
    every: Span;
    /// Maximum number of damaged bytes or repetitions.
    count: u32;
    /// The fault begins with this byte of its line, counted from 0 in the order sent.
    at_byte: u64;
    /// The fault begins with this frame of its line, counted from 0.
    at_frame: u64;
    /// The fault begins when this condition becomes true.
    when: WhenSpec;
    /// Begins when this condition is true: any condition of rules and steps.
    begins_when: Condition;
    /// Ends when this condition is true after its start, at `until` or after `lasting` at the
    /// latest.
    ends_when: Condition;
    /// Name of the random stream; by default the position in the list selects it.
    stream: String;
}

impl FaultSpec {
    /// A fault of `kind` on one direction of a link.
    pub fn on(link: &str, direction: DirectionSpec, kind: FaultKind) -> Self {
        Self {
            link: Some(link.to_owned()),
            direction: Some(direction),
            ..Self::new(kind)
        }
    }

    /// Whether the fault acts at `device` or on one of its links. A device with several ports has
    /// links such as `base:motors` and `base.1`.
    pub fn is_at(&self, device: &str) -> bool {
        let own = [&self.link, &self.with, &self.device];
        let own = own.into_iter().flatten();
        let mut all = own.chain(self.devices.iter().flatten());
        all.any(|place| is_place_of(device, place))
    }

    /// The fault that repeats `strike`.
    pub fn of_strike(link: &str, direction: DirectionSpec, strike: Strike) -> Self {
        let spec = |kind| Self {
            byte: Some(strike.byte),
            ..Self::on(link, direction, kind)
        };
        match strike.damage {
            Damage::Flip { bit } => Self {
                bit: Some(bit),
                ..spec(FaultKind::Flip)
            },
            Damage::Drop => spec(FaultKind::Drop),
            Damage::Insert { value } => Self {
                value: Some(value),
                ..spec(FaultKind::Insert)
            },
            Damage::Duplicate => spec(FaultKind::Duplicate),
            Damage::Burst { len, mask } => Self {
                len: Some(len),
                value: Some(mask),
                ..spec(FaultKind::Burst)
            },
            Damage::Truncate { len } => Self {
                len: Some(len),
                ..spec(FaultKind::Truncate)
            },
            Damage::Swap => spec(FaultKind::Swap),
            Damage::ParityError => spec(FaultKind::ParityError),
            Damage::Idle { by } => Self {
                by: Some(Span(by)),
                ..spec(FaultKind::Idle)
            },
        }
    }

    /// Maximum time window of the fault. It starts at the trigger if the fault waits for one.
    pub fn window(&self) -> Window {
        let from = self.from.map_or(Instant::ZERO, Span::instant);
        let mut until = self.until.map_or(Window::ALWAYS.until, Span::instant);
        if let (Some(lasting), None) = (self.lasting, self.every) {
            until = until.min(from + lasting.0);
        }
        Window { from, until }
    }

    /// Whether the fault waits for a condition before it begins.
    pub const fn waits_for_condition(&self) -> bool {
        self.when.is_some() || self.begins_when.is_some()
    }

    /// Whether the fault begins with a byte or a frame of its line.
    pub const fn waits_for_trigger(&self) -> bool {
        self.at_byte.is_some() || self.at_frame.is_some()
    }

    /// The condition that it waits for before it begins.
    ///
    /// # Errors
    /// If the keys of `when` contradict each other.
    pub fn begin_condition(&self) -> Result<Option<Condition>, Flaw> {
        match (&self.when, &self.begins_when) {
            (Some(when), _) => when.condition().map(Some),
            (None, begins) => Ok(begins.clone()),
        }
    }

    /// Each condition of its start and end, with its key.
    pub fn conditions(&self) -> impl Iterator<Item = (&'static str, &Condition)> {
        let both = [
            ("begins_when", self.begins_when.as_ref()),
            ("ends_when", self.ends_when.as_ref()),
        ];
        both.into_iter().filter_map(|(key, one)| Some((key, one?)))
    }

    /// The target of the fault, for a list.
    pub fn place(&self) -> String {
        match (&self.link, &self.device, &self.devices) {
            (Some(link), ..) => link.clone(),
            (None, Some(device), _) => device.clone(),
            (None, None, devices) => devices
                .iter()
                .flatten()
                .cloned()
                .collect::<Vec<_>>()
                .join(", "),
        }
    }
}

/// Error in a requested fault.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, thiserror::Error)]
#[error("{key}: {message}")]
pub struct Flaw {
    /// The key in question.
    pub key: &'static str,
    /// The error, and the expected value.
    pub message: String,
}

impl Flaw {
    /// The flaw `message` of `key`.
    pub fn new(key: &'static str, message: impl Into<String>) -> Self {
        let message = message.into();
        Self { key, message }
    }
}

/// Directions as in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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

/// Whether `place` is `device` or one of its links, such as `base:motors` and `base.1`.
pub(crate) fn is_place_of(device: &str, place: &str) -> bool {
    let rest = place.strip_prefix(device);
    rest.is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
}
