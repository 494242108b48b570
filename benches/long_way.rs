//! Does a robot that stays in a building fill its memory, or become slow? Time per scan and number
//! of keyframes on a long path.
//!
//! ```text
//! cargo bench --bench long_way -- SEED METRES
//! ```

#![expect(clippy::disallowed_methods, reason = "measures how long a scan takes")]

use std::time::Instant;

use hilrig::slam::mapping::building::Building;
use hilrig::slam::mapping::{Mapper, Settings, Shot};

/// Number of scans per line of the table.
const SCANS: usize = 500;

fn main() {
    let mut numbers = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with("--"));
    let seed = numbers
        .next()
        .and_then(|word| word.parse().ok())
        .unwrap_or(1);
    let metres = numbers
        .next()
        .and_then(|word| word.parse().ok())
        .unwrap_or(25_000.0);
    let building = Building::with_way(seed, metres);
    let mut mapper = Mapper::new(Settings {
        start: building.sights[0].truth,
        ..Settings::default()
    });
    println!("{} scans, {:.0} m", building.sights.len(), building.way_m);
    for (part, sights) in building.sights.chunks(SCANS).enumerate() {
        let mut took: Vec<u128> = Vec::with_capacity(sights.len());
        for sight in sights {
            let began = Instant::now();
            mapper.take(&Shot {
                moved: sight.moved,
                is_measured: true,
                ends: &sight.ends,
            });
            took.push(began.elapsed().as_micros());
        }
        let sum: u128 = took.iter().sum();
        took.sort_unstable();
        let (mean, median) = (sum / took.len() as u128, took[took.len() / 2]);
        let longest = took[took.len() - 1];
        let keyframes = mapper.graph().poses.len();
        println!(
            "scans from {}: {mean} us in the mean, {median} us in the median, {longest} us at \
             most; {keyframes} keyframes",
            part * SCANS
        );
    }
}
