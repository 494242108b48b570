#![no_main]
//! See `Target` in src/search/fuzz/wire.rs.

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let target = hilrig_fuzz::wire::Target::named("rle").expect("listed");
    target.fuzz(data);
});
