//! Serial devices described by data.
//!
//! A [`Description`] is read from a TOML file: line, frames, checksums, messages, state, registers
//! and behaviour. One description gives an emulated device ([`Described`]), a decoder with words
//! for every field ([`Description::cutter`], [`Description::words`]), and the rules that a driver
//! must keep. The crate has no clock, no I/O and no randomness except the named streams of
//! [`emulators::rng`].
//!
//! | module | is |
//! |---|---|
//! | [`schema`] | keys and tables of a file |
//! | [`error`] | errors in a file |
//! | [`expr`] | expressions over fields and variables |
//! | [`checksum`] | algorithms by name |
//! | [`number`] | numbers as bytes |
//! | [`value`] | values of fields and variables |
//! | [`description`] | a valid description |
//! | [`device`] | the described device |
//! | [`wire`] | several devices on one wire |
//! | [`speak`] | requests and replies in the words of a description |
//! | [`peer`] | the other end of a line: a device in virtual time, or a port |
//! | [`master`] | a host that polls a device |
//! | [`conform`] | comparison of a device with its description |
//! | [`import`] | descriptions made of register maps and other tools' structures |
//! | [`shipped`] | the descriptions that come with the tool |

mod addressed;
mod behaviour;
pub mod checksum;
mod compile;
pub mod conform;
pub mod description;
pub mod device;
mod document;
pub mod error;
pub mod expr;
mod field;
mod framing;
#[cfg(feature = "import")]
pub mod import;
mod lua;
pub mod master;
mod message;
mod modbus;
pub mod number;
mod parts;
mod pattern;
pub mod peer;
mod reference;
mod registers;
pub mod schema;
pub mod shipped;
pub mod speak;
mod state;
mod texts;
pub mod value;
mod vocabulary;
pub mod wire;

pub use compile::Files;
pub use description::{Description, Protocol};
pub use device::{Described, Place};
pub use error::{DescriptionError, Problem};
pub use framing::{Cutter, Frame, FrameBytes, Frames};
pub use lua::{LuaField, LuaPart, RUNTIME as LUA_RUNTIME};
pub use message::Message;
pub use modbus::Asked;
pub use parts::NumberPlace;
pub use schema::json_schema;
pub use schema::message::From;
pub use texts::TextChange;
pub use value::{Record, Value};
