//! The table of wire formats and the entry functions of `hilrig fuzz` without the rest of the rig,
//! so that an instrumented build takes seconds.

pub use rig::codec;
pub(crate) use rig::{hex, registry};

#[path = "../../crates/engine/src"]
#[allow(dead_code, reason = "the rest of the rig needs more of them")]
mod rig {
    pub mod codec;
    #[path = "rig/direction.rs"]
    pub mod direction;
    pub(crate) mod hex;
    pub(crate) mod registry;
}
