#![no_main]
//! See `Target` in crates/engine/src/codec/wire.rs.

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let target = hilrig_fuzz::codec::target("hc06").expect("listed");
    target.fuzz(data);
});
