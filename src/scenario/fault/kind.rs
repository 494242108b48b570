//! The kinds of faults, and which keys each of them has.

use serde::{Deserialize, Serialize};

/// Declares the kinds with their names in a file, so that none can be without.
macro_rules! kinds {
    ($($(#[doc = $doc:literal])+ $kind:ident $name:literal $place:ident [$($key:literal),*],)+) => {
        /// Kinds of faults as in a file.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        pub enum FaultKind {
            $($(#[doc = $doc])+ #[serde(rename = $name)] $kind,)+
        }

        impl FaultKind {
            /// All kinds.
            pub const ALL: &[Self] = &[$(Self::$kind),+];

            /// Name as in a file.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$kind => $name,)+ }
            }

            /// What it acts on.
            pub const fn place(self) -> Place {
                match self { $(Self::$kind => Place::$place,)+ }
            }

            /// Its keys besides those of place and time.
            pub const fn own_keys(self) -> &'static [&'static str] {
                match self { $(Self::$kind => &[$($key),*],)+ }
            }
        }
    };
}

kinds! {
    /// A bit is inverted.
    Flip "flip" Line ["rate", "byte", "bit"],
    /// A byte is lost.
    Drop "drop" Line ["rate", "byte"],
    /// A byte is inserted before another.
    Insert "insert" Line ["rate", "byte", "value"],
    /// A byte comes twice.
    Duplicate "duplicate" Line ["rate", "byte"],
    /// Some bytes in a row are garbled.
    Burst "burst" Line ["rate", "byte", "len", "value"],
    /// The rest of what is sent in one go is lost.
    Truncate "truncate" Line ["rate", "byte", "len"],
    /// Two neighbours change places.
    Swap "swap" Line ["rate", "byte"],
    /// A byte comes with wrong parity.
    ParityError "parity-error" Line ["rate", "byte"],
    /// The sender pauses in the middle.
    Idle "idle" Line ["rate", "byte", "by"],
    /// NUL is taken out.
    StripNul "strip-nul" Line [],
    /// CR becomes LF.
    CrToLf "cr-to-lf" Line [],
    /// XON and XOFF are taken out.
    EatXonXoff "eat-xon-xoff" Line [],
    /// The highest bit is cleared.
    ClearBit7 "clear-bit7" Line [],
    /// The sender hears itself.
    Echo "echo" Line [],
    /// Bytes are held back, then come all at once.
    Stall "stall" Line [],
    /// The line is clogged now and then, by chance; each time a stall.
    Clog "clog" Line ["stream"],
    /// The receiver does not look; its FIFO runs over.
    Overrun "overrun" Line ["fifo"],
    /// Bytes are handed over in small pieces.
    ShortRead "short-read" Line ["len"],
    /// Bytes come later.
    Latency "latency" Line ["by"],
    /// Bytes come later by chance, and what was delayed comes in a burst.
    Jitter "jitter" Line ["by", "stream"],
    /// Nothing gets through, and nobody is told: a half-open line.
    Cut "cut" Line [],
    /// The plug is out: nothing gets through, and the receiver is told.
    Unplugged "unplugged" Line [],
    /// The line is held low.
    Break "break" Line [],
    /// The sender runs at another rate.
    WrongBaud "wrong-baud" Line ["baud", "ppm", "ppm_per_s"],
    /// The receivers of two links get each other's bytes.
    Swizzle "swizzle" Line ["with"],
    /// Several devices lose their supply at once.
    PowerDip "power-dip" Devices [],
    /// The device has no supply.
    Off "off" Device [],
    /// The device has no supply now and then.
    Intermittent "intermittent" Device [],
    /// The device starts again.
    Restart "restart" Device [],
    /// What it measures does not change any more, or its moving part does not move.
    Stuck "stuck" Device [],
    /// It sends nonsense.
    Garbage "garbage" Device [],
    /// It measures wrongly.
    Wrong "wrong" Device ["factor"],
    /// It works too slowly.
    Slow "slow" Device [],
    /// All it sends comes late.
    Delayed "delayed" Device ["by"],
    /// What only this device can have.
    Device "device" Device ["fault", "factor"],
}

/// What a kind of fault acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// One direction of a link.
    Line,
    /// A device.
    Device,
    /// Several devices.
    Devices,
}

impl Place {
    /// Its keys.
    pub const fn keys(self) -> &'static [&'static str] {
        match self {
            Self::Line => &["link", "direction"],
            Self::Device => &["device"],
            Self::Devices => &["devices"],
        }
    }
}

/// Keys that say when, of all kinds.
pub(super) const TIME_KEYS: [&str; 8] = [
    "from", "until", "lasting", "every", "count", "at_byte", "at_frame", "when",
];

impl FaultKind {
    /// Whether it damages single bytes, at random or by number.
    pub fn is_strike(self) -> bool {
        self.own_keys().contains(&"byte")
    }

    /// Whether `key` is one of its keys.
    pub(super) fn has(self, key: &str) -> bool {
        key == "kind"
            || self.place().keys().contains(&key)
            || self.own_keys().contains(&key)
            || TIME_KEYS.contains(&key)
    }
}
