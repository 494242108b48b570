//! Faults, and their effects on the wire.

mod any;
mod boards;
mod chips;
mod control;
mod devices;
mod kinds;
mod live;
mod schedule;
mod wire;
