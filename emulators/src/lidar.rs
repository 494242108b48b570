//! Common parts of turning lidars: the head and its motor, mounting, and direction of a beam.

pub(crate) mod beam;
mod mount;
pub(crate) mod rotor;

pub use mount::{Direction, Mount};
pub use rotor::MotorSupply;
