//! Yellow: defects of its program and of the PC program, found by reading their public code.

mod bench;
mod desk;
mod driving;
mod head;
mod lidar;
mod lines;
mod link;
mod maps;
mod states;

use firmware_core::robots::yellow::Config;

use super::{Bug, Variant};

/// All defects, in the order of their numbers.
pub(super) const ROOMS: [&[Bug]; 7] = [
    &link::ROWS,
    &lidar::ROWS,
    &states::ROWS,
    &driving::ROWS,
    &lines::ROWS,
    &desk::ROWS,
    &maps::ROWS,
];

/// Settings of the program for `variant`; the defective one has the defect `id`.
fn config(variant: Variant, id: &str) -> Config {
    match variant {
        Variant::Defective => Config::DEFAULT
            .with_defect(id)
            .expect("exhibits name known defects"),
        Variant::Sound => Config::DEFAULT,
    }
}
