//! Looking for what nobody thought of: bytes into decoders, and later whole scenarios.
//!
//! A *finding* is kept as a value that people can read, never as a seed: bytes in hexadecimal, a
//! scenario as TOML. So it means the same in every later version.

pub mod wire;
