//! The behaviour of a device, compiled.

use core::time::Duration;
use std::sync::Arc;

use crate::expr::Expr;
use crate::schema::behaviour::EventSpec;

/// The cause of an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trigger {
    /// A message, by index.
    Message(usize),
    /// Any message.
    AnyMessage,
    Event(EventSpec),
}

/// An action: assignments and messages to send.
#[derive(Clone, Debug, Default)]
pub(crate) struct Deed {
    pub(crate) when: Option<Expr>,
    /// Variables and their new values.
    pub(crate) set: Vec<(usize, Expr)>,
    /// Messages, by index.
    pub(crate) send: Vec<usize>,
    /// Values for fields of the messages.
    pub(crate) with: Vec<(Arc<str>, Expr)>,
}

#[derive(Clone, Debug)]
pub(crate) struct On {
    pub(crate) trigger: Trigger,
    pub(crate) deed: Deed,
    /// Address and bytes for the registers.
    pub(crate) write: Option<(Expr, Expr)>,
    pub(crate) latency: Duration,
    pub(crate) jitter: Option<Duration>,
    pub(crate) busy: Option<Duration>,
    pub(crate) violation: Option<&'static str>,
    pub(crate) restarts: bool,
}

impl On {
    /// Whether the entry does nothing: the device ignores the message, e.g. one for another
    /// address.
    pub(crate) const fn is_ignored(&self) -> bool {
        self.deed.set.is_empty()
            && self.deed.send.is_empty()
            && self.write.is_none()
            && self.jitter.is_none()
            && self.busy.is_none()
            && self.violation.is_none()
            && !self.restarts
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Every {
    pub(crate) period: Duration,
    pub(crate) first: Duration,
    pub(crate) jitter: Option<Duration>,
    pub(crate) deed: Deed,
}

#[derive(Clone, Debug)]
pub(crate) struct After {
    pub(crate) trigger: Trigger,
    pub(crate) delay: Duration,
    pub(crate) deed: Deed,
}

/// A fault of the device, compiled.
#[derive(Clone, Debug)]
pub(crate) struct Fault {
    pub(crate) name: &'static str,
    pub(crate) about: String,
    pub(crate) set: Vec<(usize, Expr)>,
    pub(crate) freeze: Vec<usize>,
    pub(crate) late: Duration,
    pub(crate) is_mute: bool,
    pub(crate) is_bad_checksum: bool,
    /// Pairs of messages, by index: the original and its replacement.
    pub(crate) replace: Vec<(usize, usize)>,
    pub(crate) garbage: usize,
    pub(crate) restarts: bool,
}
