//! A wish of the PC to the robot, repeated until the robot shows that it has received it.

use core::time::Duration;

use protocols::Instant;

/// A wish and its progress.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Wish<T> {
    pub(super) what: T,
    insist: Insist,
    said_at: Option<Instant>,
    tries: u32,
    outcome: Outcome,
}

/// Repetition of a wish.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Insist {
    /// A limited number of times, until it is confirmed.
    UntilConfirmed { every: Duration, tries_max: u32 },
    /// Forever: the robot forgets it otherwise.
    ForEver { every: Duration },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    Unknown,
    Confirmed(Instant),
    GivenUp,
}

/// Next action for a wish.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Due {
    Nothing,
    Say,
    GiveUp,
}

impl<T> Wish<T> {
    pub(super) const fn new(what: T, insist: Insist) -> Self {
        Self {
            what,
            insist,
            said_at: None,
            tries: 0,
            outcome: Outcome::Unknown,
        }
    }

    /// Time of the next action, on an open connection.
    pub(super) fn due_at(&self) -> Option<Instant> {
        let every = match (self.insist, self.outcome) {
            (Insist::ForEver { every }, _) => every,
            (Insist::UntilConfirmed { every, .. }, Outcome::Unknown) => every,
            (Insist::UntilConfirmed { .. }, Outcome::Confirmed(_) | Outcome::GivenUp) => {
                return None;
            }
        };
        Some(self.said_at.map_or(Instant::ZERO, |at| at + every))
    }

    /// The action due now; it counts as done.
    pub(super) fn take_due(&mut self, now: Instant) -> Due {
        if self.due_at().is_none_or(|at| at > now) {
            return Due::Nothing;
        }
        match self.insist {
            Insist::UntilConfirmed { tries_max, .. } if self.tries >= tries_max => {
                self.outcome = Outcome::GivenUp;
                Due::GiveUp
            }
            Insist::UntilConfirmed { .. } | Insist::ForEver { .. } => {
                self.said_at = Some(now);
                self.tries += 1;
                Due::Say
            }
        }
    }

    /// Notes that the robot has received the wish; returns whether this is new.
    pub(super) fn confirm(&mut self, now: Instant) -> bool {
        let news = self.outcome == Outcome::Unknown && self.said_at.is_some();
        if news {
            self.outcome = Outcome::Confirmed(now);
        }
        news
    }

    /// Restarts after a lost connection: unconfirmed wishes are sent again on the next one.
    pub(super) fn start_again(&mut self) {
        self.said_at = None;
        self.tries = 0;
        if self.outcome == Outcome::GivenUp {
            self.outcome = Outcome::Unknown;
        }
    }

    /// Time at which the robot showed that it has received the wish.
    pub(super) const fn confirmed_at(&self) -> Option<Instant> {
        match self.outcome {
            Outcome::Confirmed(at) => Some(at),
            Outcome::Unknown | Outcome::GivenUp => None,
        }
    }

    /// Number of times that it was sent on this connection.
    pub(super) const fn tries(&self) -> u32 {
        self.tries
    }
}
