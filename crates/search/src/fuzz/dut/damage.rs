//! The experiment that shows whether a driver verifies the checksum of replies.
//!
//! ```text
//!  intact reply  --> next request, after a time --+
//!  damaged reply --> the same?  -- no: verified   |  each as often, twice
//!  no reply      --> repeated?  -- no: not known  |
//! ```
//!
//! A driver that verifies the checksum and repeats failed requests repeats them after a damaged
//! reply, as after a missing one. Nothing is known of a driver that always continues with its next
//! request.

use core::time::Duration;

use super::case::{Damage, Exchange, Hex, Kind, Pair};
use super::cause::Cause;
use super::player::Halt;
use super::replies::Replies;
use super::session::{Session, WHOLE};

/// Maximum number of other requests before one of the kind in question.
const OTHERS_MAX: usize = 32;
/// Two times count as the same up to this difference, or up to a fifth.
const SAME: Duration = Duration::from_millis(5);

/// Kind of reply that the program gets in a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Intact,
    Damaged,
    Missing,
}

/// The reaction of the program: the kind of its next request, whether that is the same request
/// byte by byte, and the time until it.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Reaction {
    next: Option<Hex>,
    repeats: bool,
    after: Duration,
}

impl Reaction {
    fn is_like(&self, other: &Self) -> bool {
        let is_same = self.next == other.next && self.repeats == other.repeats;
        is_same && self.after.abs_diff(other.after) <= Self::slack(self.after.max(other.after))
    }

    /// The difference up to which times count as the same.
    fn slack(after: Duration) -> Duration {
        SAME.max(after / 5)
    }

    /// Whether this is a repetition of a request of the kind `asked`, unlike the `usual` reaction:
    /// another request, one with another counter, or the same one after a longer pause.
    fn is_repetition(&self, asked: &Hex, usual: &Self) -> bool {
        let is_sooner = self.after + Self::slack(usual.after) < usual.after;
        self.next.as_ref() == Some(asked)
            && (self.next != usual.next || self.repeats && !usual.repeats || is_sooner)
    }
}

/// Executes the experiment `damage`. Adds the cause if the program accepts damaged replies. A
/// program that sends no request for `silence` is stuck. Requests that the device does not answer
/// end the experiment without a result.
pub(super) fn try_replies(
    live: &mut Session<'_>,
    damage: &Damage,
    link: &str,
    silence: Duration,
    replies: &mut Replies<'_>,
    causes: &mut Vec<Cause>,
) -> Result<(), Halt> {
    let mut trial = Trial {
        live,
        silence,
        replies,
        damage: damage.clone(),
    };
    trial.damage.to = trial.kind(&damage.to.0);
    let mut pair = None;
    let accepts = trial.accepts(&mut pair);
    let kept = trial.damage;
    live.held.damage = Some(kept);
    if let Some(pair) = pair.filter(|_| matches!(accepts, Ok(true))) {
        let link = link.to_owned();
        causes.push(Cause::Accepts { pair, link });
    }
    accepts.map(|_| ())
}

/// Whether a request of the kind `asked` was repeated after a missing reply, unlike usual.
fn is_repeated(asked: &Hex, seen: &[Reaction], usual: &[Reaction]) -> bool {
    let mut both = seen.iter().zip(usual);
    both.any(|(one, other)| one.is_repetition(asked, other))
}

struct Trial<'a, 'b, 'c> {
    live: &'a mut Session<'b>,
    silence: Duration,
    replies: &'a mut Replies<'c>,
    damage: Damage,
}

impl Trial<'_, '_, '_> {
    /// Whether the program accepts damaged replies; `pair` receives an intact and a damaged one.
    fn accepts(&mut self, pair: &mut Option<Pair>) -> Result<bool, Halt> {
        let Some(usual) = self.phase(Phase::Intact, pair)? else {
            return Ok(false);
        };
        for _ in 0..2 {
            for phase in [Phase::Damaged, Phase::Intact] {
                if !self.is_as(phase, &usual, pair)? {
                    return Ok(false);
                }
            }
        }
        for _ in 0..2 {
            // Only the same request after a missing reply shows that the driver repeats failed
            // requests. A driver that only reports a wrong checksum sends its next request, as
            // after an intact reply; it may end or wait after a missing one.
            let seen = self.phase(Phase::Missing, pair)?;
            let is_repeated = seen.is_some_and(|seen| is_repeated(&self.damage.to, &seen, &usual));
            if !is_repeated || !self.is_as(Phase::Intact, &usual, pair)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Whether the reactions in `phase` are the `usual` ones.
    fn is_as(
        &mut self,
        phase: Phase,
        usual: &[Reaction],
        pair: &mut Option<Pair>,
    ) -> Result<bool, Halt> {
        let seen = self.phase(phase, pair)?;
        Ok(seen.is_some_and(|seen| {
            let mut both = seen.iter().zip(usual);
            seen.len() == usual.len() && both.all(|(one, other)| one.is_like(other))
        }))
    }

    /// The reactions in `phase`; `None` if the requests do not come or have no known reply.
    fn phase(
        &mut self,
        phase: Phase,
        pair: &mut Option<Pair>,
    ) -> Result<Option<Vec<Reaction>>, Halt> {
        let mut seen = Vec::new();
        while (seen.len() as u64) < self.damage.count {
            let Some(asked) = self.wait_for_kind()? else {
                return Ok(None);
            };
            let now = self.live.now();
            let reply = self.replies.reply(&asked, now);
            let Some(reply) = reply.filter(|reply| reply.is_own && !reply.bytes.is_empty()) else {
                return Ok(None);
            };
            match phase {
                Phase::Intact => self.say(&reply.bytes)?,
                Phase::Missing => self.live.is_altered = true,
                Phase::Damaged => {
                    self.live.is_altered = true;
                    let Some(damaged) = self.damaged(&asked, &reply.bytes) else {
                        return Ok(None);
                    };
                    self.say(&damaged)?;
                    *pair = Some(Pair {
                        good: Hex(reply.bytes.clone()),
                        damaged: Hex(damaged),
                        noise: Hex::default(),
                    });
                }
            }
            let next = self.hear()?;
            let after = self.live.now() - now;
            if let Some(heard) = &next {
                self.live.unhear(heard);
            } else if phase == Phase::Missing {
                // The program may wait forever for the reply.
                self.say(&reply.bytes)?;
            }
            let repeats = next.as_ref() == Some(&asked);
            let next = next.map(|heard| self.kind(&heard));
            seen.push(Reaction {
                next,
                repeats,
                after,
            });
        }
        Ok(Some(seen))
    }

    /// The next request of the kind in question; the others get intact replies.
    fn wait_for_kind(&mut self) -> Result<Option<Vec<u8>>, Halt> {
        for _ in 0..OTHERS_MAX {
            let Some(asked) = self.hear()? else {
                return Ok(None);
            };
            if self.kind(&asked) == self.damage.to {
                return Ok(Some(asked));
            }
            let now = self.live.now();
            let reply = self.replies.reply(&asked, now);
            let Some(reply) = reply.filter(|reply| reply.is_own) else {
                return Ok(None);
            };
            self.say(&reply.bytes)?;
        }
        Ok(None)
    }

    /// A known request of the kind of `request`.
    fn kind(&mut self, request: &[u8]) -> Hex {
        let mut known = self.damage.kinds.iter();
        if let Some(known) = known.find(|known| known.request.0 == request) {
            return known.of.clone();
        }
        let of = self.replies.alike(request).first().copied().cloned();
        let request = Hex(request.to_vec());
        let of = of.unwrap_or_else(|| request.clone());
        let kind = Kind {
            request,
            of: of.clone(),
        };
        self.damage.kinds.push(kind);
        of
    }

    /// The damaged `reply` to `request`.
    fn damaged(&mut self, request: &[u8], reply: &[u8]) -> Option<Vec<u8>> {
        let mut sent = self.damage.sent.iter();
        if let Some(one) = sent.find(|one| one.request.0 == request) {
            return Some(one.reply.0.clone());
        }
        let damaged = self.replies.damaged(self.damage.seed, reply)?;
        self.damage.sent.push(Exchange {
            request: Hex(request.to_vec()),
            reply: Hex(damaged.clone()),
        });
        Some(damaged)
    }

    fn hear(&mut self) -> Result<Option<Vec<u8>>, Halt> {
        let replies = &*self.replies;
        let is_known = |heard: &[u8]| replies.is_recorded(heard);
        self.live.hear(self.silence, WHOLE, &is_known)
    }

    fn say(&mut self, bytes: &[u8]) -> Result<(), Halt> {
        self.live.say(bytes)?;
        self.live.flush()
    }
}
