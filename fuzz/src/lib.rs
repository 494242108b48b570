//! The entry functions of `hilrig fuzz` without the rest of the rig, so that an instrumented build
//! takes seconds.

pub use fuzz::wire;

#[path = "../../src/hex.rs"]
mod hex;

#[path = "../../src/search/fuzz"]
mod fuzz {
    pub mod wire;
}
