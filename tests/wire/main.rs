//! The wire formats against the world: golden frames of real devices both ways, real captures,
//! and the laws that every decoder keeps, each law proved by a mutant that breaks it.
//!
//! Emulators and firmware use the same codecs, so a symmetrical mistake would cancel out in every
//! other test of this repository. No test here takes an expected value from our own encoders.

mod avr;
mod car_board;
mod corpus;
mod decode;
mod foreign;
mod garbage;
mod hc06;
mod laws;
mod mutants;
mod odometer;
mod panel;
mod pcui;
mod peripherals;
mod protocol;
mod rle;
mod rplidar;
mod telemetry;
mod xv11;

#[path = "../support/captures.rs"]
mod captures;
#[path = "../support/damage.rs"]
mod damage;
#[path = "../support/thorough.rs"]
mod thorough;

/// Bytes from a line of hexadecimal pairs, as datasheets and captures are quoted.
fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace()
        .map(|pair| u8::from_str_radix(pair, 16).expect("pairs of hexadecimal digits"))
        .collect()
}
