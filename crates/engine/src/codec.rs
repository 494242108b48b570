//! Table of the wire formats, one row each, and the functions that use it to print bytes as text.
//!
//! A [`Codec`] holds all the tool's knowledge of a format. `decode`, `--diagnose`, `shrink`,
//! `fuzz`, the page, the museum and the dissector for Wireshark ask the table. So all of them know
//! a custom format once it is registered:
//!
//! ```no_run
//! use hilrig_engine::codec::{self, Codec, wire::Wire};
//! # struct Gripper;
//! # impl Wire for Gripper {
//! #     type Decoder = protocols::pcui::Decoder;
//! #     const NAME: &'static str = "gripper";
//! #     fn decoder() -> Self::Decoder { Self::Decoder::default() }
//! #     fn bytes(frame: &protocols::pcui::Frame) -> &[u8] { frame.as_bytes() }
//! #     fn build(_: &mut codec::wire::Choices<'_>, _: &mut Vec<u8>) {}
//! #     fn repair(_: &mut [u8]) {}
//! #     fn frame_at(_: &[u8]) -> Option<usize> { None }
//! # }
//! // struct Gripper; impl Wire for Gripper { .. }
//! // Then `hilrig::cli::main()` has it in all commands.
//! codec::register(Codec::of::<Gripper>("Gripper of our own")).expect("a new name");
//! ```
//!
//! Each process has one table: built-in formats first, then registered ones in their order. If two
//! formats fit some bytes equally well, the earlier one is used.

mod answers;
mod any_decoder;
mod bus;
mod car_board;
mod evidence;
mod fields;
mod floor;
mod lidar;
mod lua;
mod odometer;
mod osc;
mod panel;
mod pcui;
mod perception;
mod peripherals;
mod row;
mod rplidar;
mod stream;
#[cfg(feature = "robots")]
mod telemetry;
pub mod wire;
pub mod words;
mod xv11;
mod xv11_turn;

pub use answers::Answers;
pub use any_decoder::AnyDecoder;
pub use bus::{Avr, BUS, BUS_HIGH_FIRST, HighFirst, LowFirst, NamedRegister, RegisterNames, bus};
pub use car_board::{CAR_BOARD, CAR_COMMAND, CarBoard, CarCommand, Pair, PairFormat};
pub use evidence::Evidence;
pub use fields::value_in;
pub use floor::Floor;
pub use lidar::{Lidar, Ranges};
pub use lua::{Lua, LuaField, field};
pub use odometer::{Line, LineFormat, ODOMETER, Odometer};
pub use osc::{OSC, Osc, OscFormat, OscMessage};
pub use panel::{PANEL, Panel};
pub use pcui::{PCUI, Pcui};
pub use perception::{MessageFormat, PERCEPTION, Perception, Told};
pub use peripherals::{BoardFrame, PERIPHERALS, Peripherals};
pub use row::{Codec, IDLE, OtherOrder, OwnFormat, Pause};
pub use rplidar::{RPLIDAR, Rplidar};
pub use stream::{BAD_MAX, Count, Counter, FrameBytes, Stream, Stretch, What};
#[cfg(feature = "robots")]
pub use telemetry::{TELEMETRY, Telemetry};
pub use xv11::{XV11, Xv11};
pub use xv11_turn::{XV11_TURN, Xv11Turns};

use crate::registry::{NameTaken, Registry};
use wire::Target;

static CODECS: Registry<Codec> = Registry::new(&[
    &XV11,
    &XV11_TURN,
    &BUS,
    &BUS_HIGH_FIRST,
    &PCUI,
    &PANEL,
    &RPLIDAR,
    #[cfg(feature = "robots")]
    &TELEMETRY,
    &PERIPHERALS,
    &CAR_BOARD,
    &ODOMETER,
    &CAR_COMMAND,
    &PERCEPTION,
    &OSC,
]);

/// All rows: those that are built in, then those that were registered.
pub fn all() -> Vec<&'static Codec> {
    CODECS.all()
}

/// The row called `name`.
pub fn find(name: &str) -> Option<&'static Codec> {
    CODECS.find(name)
}

/// All names in alphabetical order, for a message.
pub fn names() -> Vec<&'static str> {
    CODECS.names()
}

/// Adds a row to the table, for the life of the process.
///
/// # Errors
/// If the table already has a row of this name, or a fuzz target of this target name.
pub fn register(codec: Codec) -> Result<&'static Codec, NameTaken> {
    if let Some(taken) = target(codec.target().name) {
        return Err(NameTaken::new(taken.name));
    }
    CODECS.register(Box::new(codec))
}

/// The row with the most bytes of `bytes` in valid frames, among the rows with enough evidence: see
/// [`Evidence`].
pub fn guess(bytes: &[u8]) -> Option<&'static Codec> {
    best(bytes).map(|(codec, _)| codec)
}

/// As [`guess`], with the number of these bytes.
pub fn best(bytes: &[u8]) -> Option<(&'static Codec, u64)> {
    let mut best = None;
    for codec in all() {
        let evidence = Evidence::of(codec, bytes);
        let score = evidence.framed;
        let is_better = score > best.map_or(0, |(_, best)| best);
        if is_better && evidence.is_enough(codec.floor()) {
            best = Some((codec, score));
        }
    }
    best
}

/// All decoders that accept any bytes: those of the table, then those without frames.
pub fn targets() -> Vec<&'static Target> {
    let rows = all()
        .into_iter()
        .filter(|row| !row.is_own())
        .map(Codec::target);
    rows.chain(&Target::TEXTS).collect()
}

/// The target called `name`.
pub fn target(name: &str) -> Option<&'static Target> {
    targets().into_iter().find(|target| target.name == name)
}

#[cfg(test)]
mod tests;
