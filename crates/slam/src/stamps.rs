//! Whether the time of a log continues.

/// Scans in a row that are older than an earlier one until the clock is believed to be set back.
const SET_BACK_AFTER: u32 = 3;
/// Scans are written a little out of order now and then: in a public log by up to 0.9 s.
const JITTER_S: f64 = 1.0;

/// Whether time continues; it may be set back, which several scans in a row then say.
#[derive(Default)]
pub(super) struct LogClock {
    newest: Option<f64>,
    older: u32,
}

impl LogClock {
    pub(super) fn accepts(&mut self, at_s: f64) -> bool {
        if self.newest.is_some_and(|newest| at_s < newest - JITTER_S) {
            self.older += 1;
            if self.older < SET_BACK_AFTER {
                return false;
            }
        }
        let newest = self.newest.filter(|_| self.older == 0);
        self.newest = Some(newest.map_or(at_s, |newest| newest.max(at_s)));
        self.older = 0;
        true
    }
}
