//! Captures put to use: decoded, compared, replayed, kept as cases, imported, exported.
//!
//! The file itself, and what writes and reads it, is the crate `recording`, whose items stand here
//! as well.

pub mod case;
pub mod decode;
pub mod divergence;
pub mod export;
pub mod import;
pub mod replay;
pub mod wireshark;

pub use recording::pcapng;
pub use recording::{
    Capture, Conclusion, Existing, Interface, Item, Kind, Limits, Reader, Record, Recording,
    Section, Sent, about, about_live, event_words, record,
};
