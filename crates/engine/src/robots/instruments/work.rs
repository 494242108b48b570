//! The steady work of a robot's program: its counters, its cyclic frames and its requests.

use core::time::Duration;

use crate::rig::Rig;
use crate::rig::line::Direction;

/// A counter of the program that grows when a link fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alarm {
    /// Name of the link.
    pub link: &'static str,
    /// Name of the counter.
    pub counter: &'static str,
}

impl Alarm {
    /// The counter `counter` for failures of `link`.
    pub const fn new(link: &'static str, counter: &'static str) -> Self {
        Self { link, counter }
    }
}

/// A kind of frame that the program sends steadily.
#[derive(Clone, Copy, Debug)]
pub struct Cycle {
    /// Name of the link.
    pub link: &'static str,
    /// Name of the frames.
    pub name: &'static str,
    /// Whether a valid frame is of this kind.
    pub is: fn(&[u8]) -> bool,
    /// Maximum time between two such frames.
    pub within: Duration,
    /// Maximum number of such frames in a second; 0: any.
    pub at_most: u64,
    /// Whether every program of the robot sends them; otherwise they are expected only after some
    /// were sent in time.
    pub is_always: bool,
    /// Whether each frame has its own time, so that no two are equal.
    pub is_dated: bool,
    /// Modes in which they are not sent.
    pub except: &'static [&'static str],
}

impl Cycle {
    /// Frames of a kind that every program of the robot sends on `link`.
    pub const fn new(
        link: &'static str,
        name: &'static str,
        within: Duration,
        is: fn(&[u8]) -> bool,
    ) -> Self {
        Self {
            link,
            name,
            is,
            within,
            at_most: 0,
            is_always: true,
            is_dated: false,
            except: &[],
        }
    }

    /// Limits the number of frames in a second.
    #[must_use]
    pub const fn at_most(mut self, count: u64) -> Self {
        self.at_most = count;
        self
    }

    /// Frames that some programs of the robot do not send.
    #[must_use]
    pub const fn optional(mut self) -> Self {
        self.is_always = false;
        self
    }

    /// Frames that each have their own time.
    #[must_use]
    pub const fn dated(mut self) -> Self {
        self.is_dated = true;
        self
    }

    /// Excludes these modes.
    #[must_use]
    pub const fn except(mut self, modes: &'static [&'static str]) -> Self {
        self.except = modes;
        self
    }
}

/// A link on which the program asks and a device replies.
#[derive(Clone, Copy, Debug)]
pub struct Asking {
    /// Name of the link.
    pub link: &'static str,
    /// Whether a valid frame of the device, the second argument, answers a request.
    pub is_answer: fn(&[u8], &[u8]) -> bool,
    /// Counter of the program for answered requests.
    pub counter: &'static str,
}

/// Counters of a program for the frames of one direction of a link.
#[derive(Clone, Copy, Debug)]
pub struct Intake {
    /// Name of the link.
    pub link: &'static str,
    /// Direction of the frames.
    pub direction: Direction,
    /// Numbers of accepted and of rejected frames; `None` if the counters are not in this process.
    pub counts: fn(&Rig) -> Option<[u64; 2]>,
    /// Whether the program may ignore valid frames, for instance while its port is closed.
    pub may_ignore: bool,
}

impl Intake {
    /// The counters of the robot's program for the frames of `link`.
    pub const fn new(link: &'static str, counts: fn(&Rig) -> Option<[u64; 2]>) -> Self {
        Self {
            link,
            direction: Direction::ToMaster,
            counts,
            may_ignore: false,
        }
    }
}

/// Sums of the program's counters called `accepted`, and of those called `rejected`.
pub fn counted(rig: &Rig, accepted: &[&str], rejected: &[&str]) -> Option<[u64; 2]> {
    let mut sums = [0; 2];
    rig.program()?.counters(&mut |name, value| {
        for (sum, names) in sums.iter_mut().zip([accepted, rejected]) {
            if names.contains(&name) {
                *sum += value;
            }
        }
    });
    Some(sums)
}
