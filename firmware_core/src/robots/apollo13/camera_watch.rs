//! Detects a silent or blind camera: the car must not drive to a position without it.

use core::time::Duration;

use protocols::Instant;

/// Longest time between two scans with a reading. The camera sends 15 to 30 a second.
const SILENT: Duration = Duration::from_millis(700);

/// The watch.
#[derive(Clone, Debug, Default)]
pub struct CameraWatch {
    seen: Option<Instant>,
    is_silent: bool,
    silences: u64,
}

impl CameraWatch {
    /// Takes the arrival of a scan with a reading. A scan without a reading counts if an obstacle
    /// is nearer than the camera's minimum range.
    pub const fn see(&mut self, now: Instant) {
        self.seen = Some(now);
    }

    /// Advances the state in time.
    pub fn poll(&mut self, now: Instant) {
        let is_blind = self.is_blind(now);
        let was_silent = core::mem::replace(&mut self.is_silent, is_blind);
        let begins = self.seen.is_some() && self.is_silent && !was_silent;
        self.silences += u64::from(begins);
    }

    /// Whether the car does not see: no scan has come for a while.
    pub fn is_blind(&self, now: Instant) -> bool {
        now - self.seen.unwrap_or(Instant::ZERO) > SILENT
    }

    /// Number of times that a camera at work fell silent.
    pub const fn silences(&self) -> u64 {
        self.silences
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The car is blind from 701 ms after the start, and from 701 ms after the last scan. A camera
    /// that has not worked yet does not fall silent.
    #[test]
    fn a_camera_is_silent_700_ms_after_its_last_scan() {
        let at = Instant::from_millis;
        let mut watch = CameraWatch::default();
        watch.poll(at(5_000));
        assert!(watch.is_blind(at(5_000)) && watch.silences() == 0);
        watch.see(at(5_000));
        for (now, silences) in [(5_700, 0), (5_701, 1), (9_000, 1)] {
            watch.poll(at(now));
            assert_eq!(
                (watch.is_blind(at(now)), watch.silences()),
                (silences > 0, silences)
            );
        }
        watch.see(at(9_000));
        watch.poll(at(9_100));
        watch.poll(at(9_800));
        assert_eq!(watch.silences(), 2);
    }
}
