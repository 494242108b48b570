//! Prints the fingerprint of the mapper's poses and maps; see `prove.sh`.

#[expect(dead_code, reason = "shared with the stories")]
#[path = "../../../firmware_core/tests/mapping/measure.rs"]
mod measure;
#[path = "../../../firmware_core/tests/mapping/scenes.rs"]
mod scenes;
#[expect(dead_code, reason = "shared with the stories")]
#[path = "../../../firmware_core/tests/mapping/world.rs"]
mod world;

fn main() {
    println!("{:016x}", scenes::fingerprint());
}
