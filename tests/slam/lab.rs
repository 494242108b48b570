//! The public Intel Lab log, its hand-checked relations, and the path from odometry alone.

use std::io::Read as _;

use emulators::world::Pose;
use hilrig::slam::motion::{between, moved};

use crate::captures::beside;
use crate::relations::Track;

/// The relations count from 1970, the log from its own beginning.
pub(crate) const SHIFT_S: f64 = 976_052_857.337_284;

/// The log's text and the relations.
pub(crate) fn data() -> Option<(Vec<u8>, String)> {
    let packed = beside("data/intel", "intel-corrected.log.gz")?;
    let relations = beside("data/intel", "intel.relations")?;
    let mut text = Vec::new();
    flate2::read::GzDecoder::new(&packed[..])
        .read_to_end(&mut text)
        .expect("a whole file");
    Some((text, String::from_utf8(relations).expect("numbers")))
}

/// Path from odometry alone, over all ODOM lines with a time. Between two FLASER lines, poses
/// differ by odometry; the jump at each FLASER line is the mapper's correction.
pub(crate) fn wheels(text: &[u8]) -> Track {
    let (mut raw, mut last, mut all) = (Pose::default(), None, Vec::new());
    for line in String::from_utf8_lossy(text).lines() {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let number = |at: usize| fields[at].parse::<f64>().expect("a number");
        let pose = |at: usize| Pose::new(number(at), number(at + 1), number(at + 2));
        match fields.first() {
            Some(&"ODOM") => {
                let here = pose(1);
                raw = last.map_or(raw, |last| moved(raw, between(last, here)));
                last = Some(here);
                let stamp = number(fields.len() - 3);
                if stamp > 0.0 {
                    all.push((stamp, raw));
                }
            }
            Some(&"FLASER") => last = Some(pose(fields.len() - 9)),
            _ => {}
        }
    }
    Track::new(all)
}
