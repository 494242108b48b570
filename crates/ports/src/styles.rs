//! The traits for drivers, one file per style.

#[cfg(feature = "embedded")]
mod embedded_hal;
#[cfg(feature = "embedded")]
mod embedded_io;
#[cfg(feature = "futures")]
mod futures;
#[cfg(feature = "serialport")]
mod serial;
#[cfg(feature = "tokio")]
mod tokio;

#[cfg(feature = "embedded")]
pub use embedded_hal::{Delay, I2cError, I2cPort, PinError, PinPort};
