//! A check that the time of a log continues.

/// Number of consecutive older scans after which the clock counts as set back.
const SET_BACK_AFTER: u32 = 3;
/// Tolerance for scans in wrong order: up to 0.9 s in a public log.
const JITTER_S: f64 = 1.0;

/// The newest time of a log. The clock may be set back; several consecutive scans confirm this.
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
