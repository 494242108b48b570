//! The table of wire formats and the entry functions of `hilrig fuzz` without the rest of the rig,
//! so that an instrumented build takes seconds.

#[path = "../../src/codec.rs"]
pub mod codec;
#[path = "../../src/hex.rs"]
#[expect(dead_code, reason = "the rig writes more spellings")]
mod hex;
#[path = "../../src/registry.rs"]
#[expect(dead_code, reason = "the rig lists names")]
mod registry;
