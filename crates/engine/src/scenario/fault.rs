//! Settings of links, and what goes wrong on them.

mod catalogue;
mod keys;
mod kind;
mod plan;
mod schedule;
mod when;

use protocols::Instant;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Span;
use crate::rig::fault::{Damage, Strike, Window};
use crate::rig::line::Direction;

pub use catalogue::catalogue;
pub use kind::{FaultKind, FaultPlace};
pub use when::WhenSpec;

/// Settings of a link.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LinkSpec {
    /// Time between the last bit on the wire and the receiver seeing it, both ways.
    #[serde(default)]
    pub latency: Span,
    /// What the client's end of the link is plugged into, in real time: what it reads is gathered
    /// and cut as that does it. In virtual time it changes nothing.
    #[serde(default, skip_serializing_if = "AdapterSpec::is_direct")]
    pub adapter: AdapterSpec,
}

/// An adapter between a UART and its client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AdapterSpec {
    /// None: bytes come as the device sends them.
    #[default]
    Direct,
    /// Up to 62 bytes each 16 ms.
    Ftdi,
    /// Up to 64 bytes each 4 ms.
    Cp2102,
    /// Up to 32 bytes each millisecond.
    Ch340,
}

impl AdapterSpec {
    /// Whether there is none.
    pub fn is_direct(&self) -> bool {
        *self == Self::Direct
    }
}

/// Declares the keys of a fault: each is optional, and which are given can be listed.
macro_rules! fault_spec {
    ($($(#[doc = $doc:literal])+ $key:ident: $type:ty $(, $least:literal to $most:literal)?;)+) => {
        /// Something that goes wrong. Which keys belong together depends on the kind.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        #[schemars(transform = keys::add_to_schema)]
        pub struct FaultSpec {
            /// What happens.
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
    /// Which link, by its name.
    link: String;
    /// Which way.
    direction: DirectionSpec;
    /// Which device, by its name.
    device: String;
    /// Which devices, by their names.
    devices: Vec<String>;
    /// Chance per byte, or per message of an I2C or datagram link, 0 to 1.
    rate: f64, 0.0 to 1.0;
    /// Number of the one byte, or message, that is hit, counted from 0 as sent.
    byte: u64;
    /// For `flip`: which bit, 0 to 7.
    bit: u8, 0 to 7;
    /// For `insert`: which value; for `burst`: the bits inverted; 0 to 255.
    value: u8;
    /// How many bytes, 1 to 65535; 4 for `burst`, 4096 for `truncate`, 1 for `short-read` if not
    /// given.
    len: u16, 1 to 65_535;
    /// For how many bytes the receiver has room, 0 to 65535; 2 if not given.
    fifo: u16;
    /// By how much time, at most an hour.
    by: Span;
    /// Rate of the sender, bit/s, 50 to 50000000.
    baud: u32, 50 to 50_000_000;
    /// Millionths by which the sender is too fast, -1000000 to 1000000.
    ppm: f64, -1_000_000.0 to 1_000_000.0;
    /// Millionths by which it gets faster each second, -1000000 to 1000000.
    ppm_per_s: f64, -1_000_000.0 to 1_000_000.0;
    /// The other link, by its name.
    with: String;
    /// For `unplugged`: the name by which the client's port comes back, if it is another one.
    back_as: String;
    /// Name of what this device can have.
    fault: String;
    /// By which factor, or how much, -1000000 to 1000000.
    factor: f64, -1_000_000.0 to 1_000_000.0;
    /// Begins here instead of at the start of the run.
    from: Span;
    /// Ends here instead of at the end of the run.
    until: Span;
    /// Ends after this time; with `every`, each spell does.
    lasting: Span;
    /// Comes again after this time, at least 100us.
    every: Span;
    /// Is over after so many strikes or spells.
    count: u32;
    /// Begins with this byte of its line, counted from 0 as sent.
    at_byte: u64;
    /// Begins with this frame of its line, counted from 0.
    at_frame: u64;
    /// Begins when this holds.
    when: WhenSpec;
    /// Name of the dice; by default the place in the list decides.
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

    /// The fault that does once more what `strike` did.
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

    /// When it may be at work; from its trigger on, if it waits for one.
    pub fn window(&self) -> Window {
        let from = self.from.map_or(Instant::ZERO, Span::instant);
        let mut until = self.until.map_or(Window::ALWAYS.until, Span::instant);
        if let (Some(lasting), None) = (self.lasting, self.every) {
            until = until.min(from + lasting.0);
        }
        Window { from, until }
    }

    /// Where it acts, for a list.
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

/// What is wrong with a requested fault.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, thiserror::Error)]
#[error("{key}: {message}")]
pub struct Flaw {
    /// The key in question.
    pub key: &'static str,
    /// What is wrong and what was expected.
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
