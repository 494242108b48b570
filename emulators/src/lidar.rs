//! What turning lidars have in common: the head and its motor, where they sit, where a beam goes.

pub(crate) mod beam;
mod mount;
pub(crate) mod rotor;

pub use mount::{Direction, Mount};
pub use rotor::MotorSupply;
