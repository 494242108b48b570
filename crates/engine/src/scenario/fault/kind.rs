//! The kinds of faults and their keys.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::rig::LinkKind;

/// Links on which single bytes travel.
const SERIAL: &[LinkKind] = &[LinkKind::Uart, LinkKind::Pin];
/// Links with messages, including those that deliver messages independently.
const PACKETS: &[LinkKind] = &[LinkKind::Uart, LinkKind::Pin, LinkKind::Datagram];
const EVERY: &[LinkKind] = &LinkKind::ALL;
const NONE: &[LinkKind] = &[];

/// Declares the kinds with their names in a file, so that every kind has a name.
macro_rules! kinds {
    ($(
        $(#[doc = $doc:literal])+
        $kind:ident $name:literal $(| $alias:literal)? $place:ident $links:ident
        [$($key:literal),*],
    )+) => {
        /// Kinds of faults as in a file.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
        pub enum FaultKind {
            $($(#[doc = $doc])+ #[serde(rename = $name $(, alias = $alias)?)] $kind,)+
        }

        impl FaultKind {
            /// All kinds.
            pub const ALL: &[Self] = &[$(Self::$kind),+];

            /// Name as in a file.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$kind => $name,)+ }
            }

            /// Target of the fault.
            pub const fn place(self) -> FaultPlace {
                match self { $(Self::$kind => FaultPlace::$place,)+ }
            }

            /// Types of links that the fault supports; empty if it does not act on one link.
            pub const fn links(self) -> &'static [LinkKind] {
                match self { $(Self::$kind => $links,)+ }
            }

            /// Its effect, in a sentence.
            pub const fn about(self) -> &'static str {
                match self { $(Self::$kind => concat!($($doc),+).trim_ascii_start(),)+ }
            }

            /// Its keys, without those for target and time.
            pub const fn own_keys(self) -> &'static [&'static str] {
                match self { $(Self::$kind => &[$($key),*],)+ }
            }
        }
    };
}

kinds! {
    /// A bit is inverted.
    Flip "flip" Line SERIAL ["rate", "byte", "bit"],
    /// A byte, packet or transaction is lost.
    Drop "drop" Line EVERY ["rate", "byte"],
    /// A byte is inserted before another one.
    Insert "insert" Line SERIAL ["rate", "byte", "value"],
    /// A byte or packet arrives twice.
    Duplicate "duplicate" Line PACKETS ["rate", "byte"],
    /// Several bytes in a row are garbled.
    Burst "burst" Line SERIAL ["rate", "byte", "len", "value"],
    /// A byte and all bytes after it, up to the sender's next pause, are lost.
    Truncate "truncate" Line SERIAL ["rate", "byte", "len"],
    /// Two neighbouring bytes or packets are swapped.
    Swap "swap" | "reorder" Line PACKETS ["rate", "byte"],
    /// A byte arrives with wrong parity.
    ParityError "parity-error" Line SERIAL ["rate", "byte"],
    /// The sender pauses before a byte.
    Idle "idle" Line SERIAL ["rate", "byte", "by"],
    /// NUL is removed.
    StripNul "strip-nul" Line SERIAL [],
    /// CR becomes LF.
    CrToLf "cr-to-lf" Line SERIAL [],
    /// XON and XOFF are removed.
    EatXonXoff "eat-xon-xoff" Line SERIAL [],
    /// The highest bit is cleared.
    ClearBit7 "clear-bit7" Line SERIAL [],
    /// The sender receives its own bytes.
    Echo "echo" Line SERIAL [],
    /// Bytes are held back, then delivered all at once.
    Stall "stall" Line EVERY [],
    /// A stall at random times.
    Clog "clog" Line EVERY ["stream"],
    /// The receiver does not read; its FIFO overflows.
    Overrun "overrun" Line SERIAL ["fifo"],
    /// Bytes are delivered in small pieces.
    ShortRead "short-read" Line SERIAL ["len"],
    /// Bytes arrive later.
    Latency "latency" Line PACKETS ["by"],
    /// Bytes arrive later at random, and delayed bytes arrive in a burst.
    Jitter "jitter" Line PACKETS ["by", "stream"],
    /// All bytes are lost without notice: a half-open line.
    Cut "cut" Line EVERY [],
    /// The plug is pulled: all bytes are lost, the receiver gets an error, and a client's port
    /// hangs up, disappears and later returns.
    Unplugged "unplugged" Line PACKETS ["back_as"],
    /// The line is held low.
    Break "break" Line SERIAL [],
    /// The sender runs at another rate.
    WrongBaud "wrong-baud" Line SERIAL ["baud", "ppm", "ppm_per_s"],
    /// The receivers of two links get each other's bytes.
    Swizzle "swizzle" Line SERIAL ["with"],
    /// Several devices lose their supply at once.
    PowerDip "power-dip" Devices NONE [],
    /// The device has no supply.
    Off "off" Device NONE [],
    /// The device repeatedly has no supply.
    Intermittent "intermittent" Device NONE [],
    /// The device starts again.
    Restart "restart" Device NONE [],
    /// Measured values of the device no longer change, or its moving part stands still.
    Stuck "stuck" Device NONE [],
    /// The device sends garbage.
    Garbage "garbage" Device NONE [],
    /// The device measures wrong values.
    Wrong "wrong" Device NONE ["factor"],
    /// The device works too slowly.
    Slow "slow" Device NONE ["factor"],
    /// All bytes of the device are sent late.
    Delayed "delayed" Device NONE ["by"],
    /// A fault specific to this device.
    Device "device" Device NONE ["fault", "factor"],
}

/// Target of a kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultPlace {
    /// One direction of a link.
    Line,
    /// A device.
    Device,
    /// Several devices.
    Devices,
}

impl FaultPlace {
    /// Its keys.
    pub const fn keys(self) -> &'static [&'static str] {
        match self {
            Self::Line => &["link", "direction"],
            Self::Device => &["device"],
            Self::Devices => &["devices"],
        }
    }
}

/// Keys for the time, valid for all kinds.
pub(super) const TIME_KEYS: [&str; 10] = [
    "from",
    "until",
    "lasting",
    "every",
    "count",
    "at_byte",
    "at_frame",
    "when",
    "begins_when",
    "ends_when",
];

impl FaultKind {
    /// Whether the fault damages single bytes, at random or by number.
    pub fn is_strike(self) -> bool {
        self.own_keys().contains(&"byte")
    }

    /// Whether the fault can act on a link of this kind.
    pub fn fits(self, link: LinkKind) -> bool {
        self.links().contains(&link)
    }

    /// Whether `key` is one of its keys.
    pub(super) fn has(self, key: &str) -> bool {
        key == "kind"
            || self.place().keys().contains(&key)
            || self.own_keys().contains(&key)
            || TIME_KEYS.contains(&key)
    }
}
