//! Decoding of captures and dumps to text, and diagnosis of damage that affects a whole stream.

pub mod diagnose;
pub mod framed;
pub mod pause;
pub mod profile;
pub mod transcript;
