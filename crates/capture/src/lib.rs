//! Use of captures: decoding, comparison, replay, cases, import, export.
//!
//! The file format, its reader and its writer are in the crate `recording`, whose items are
//! re-exported here.

pub mod case;
pub mod decode;
pub mod divergence;
pub mod export;
pub mod import;
pub mod likeness;
pub mod replay;
pub mod wireshark;

pub use recording::pcapng;
pub use recording::{
    Capture, Conclusion, Existing, Interface, Item, Kind, Limits, Reader, Record, Recording,
    Section, Sent, about, about_live, event_words, record, write_whole,
};
