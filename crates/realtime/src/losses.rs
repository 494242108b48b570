//! Bytes that a port lost because its client did not read. The log gets a note at the start and at
//! the end of a loss, so that a client which is always a little late does not fill it.

use core::time::Duration;

use protocols::Instant;

/// Rule of the notes.
pub(super) const RULE: &str = "port-overrun";
/// Rig time without a further loss after which the loss has ended.
const OVER: Duration = Duration::from_millis(200);
/// Minimum rig time between two notes about a start.
const TOLD_EVERY: Duration = Duration::from_secs(1);

/// Lost bytes of one port.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Losses {
    /// Lost bytes so far, those already reported, and the time of the last loss.
    lost: u64,
    told: u64,
    last_at: Instant,
    /// Start of the current loss.
    began: Option<Instant>,
    told_at: Option<Instant>,
}

impl Losses {
    /// Updates the count to `lost` bytes at `now`; returns a text for the log if one is due.
    pub(super) fn see(&mut self, now: Instant, lost: u64) -> Option<String> {
        if lost > self.lost {
            self.lost = lost;
            self.last_at = now;
            if self.began.is_some() {
                return None;
            }
            self.began = Some(now);
            let is_new = self.told_at.is_none_or(|at| now - at >= TOLD_EVERY);
            return is_new.then(|| {
                self.told_at = Some(now);
                "the client does not read and its port is full: bytes are lost".to_owned()
            });
        }
        let began = self.began.filter(|_| now - self.last_at >= OVER)?;
        self.began = None;
        let bytes = lost - self.told;
        self.told = lost;
        let time = (self.last_at - began).as_secs_f64();
        Some(format!(
            "{bytes} B were lost in {time:.2} s until the client read again"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_is_told_at_its_beginning_and_with_its_figure_at_its_end() {
        let mut losses = Losses::default();
        let mut see = |millis, lost| losses.see(Instant::from_millis(millis), lost);
        assert_eq!(see(0, 0), None);
        assert!(see(100, 5).is_some_and(|said| said.contains("bytes are lost")));
        assert_eq!(see(1_100, 3_000), None);
        assert_eq!(see(1_250, 3_000), None);
        let said = see(1_300, 3_000).expect("it is over");
        assert!(said.starts_with("3000 B were lost in 1.00 s"), "{said}");
        assert_eq!(see(1_400, 3_000), None);
        assert!(see(2_000, 3_001).is_some());
    }
}
