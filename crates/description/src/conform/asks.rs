//! The requests of a description for other tests of a device, and their effect on it.

use core::time::Duration;

use super::probes::{self, Probe};
use super::{answer, patience};
use crate::behaviour::{On, Trigger};
use crate::description::Description;
use crate::framing::Frame;
use crate::peer::Heard;
use crate::schema::behaviour::EventSpec;
use crate::schema::message::From;
use crate::state::Source;

/// A request that a test sends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ask {
    /// The request in words.
    pub place: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// Whether the request may change the device's state.
    pub changes: bool,
}

impl Description {
    /// All requests that a [comparison](super::conform) sends, without damaged ones.
    pub fn asks(&self) -> Vec<Ask> {
        let probes = probes::of(self).into_iter();
        let asks = probes
            .filter(|probe| probe.asks.is_some() && !probe.bytes.is_empty() && !probe.is_again);
        let mut asks: Vec<Ask> = asks
            .map(|probe| Ask {
                place: probe.place,
                bytes: probe.bytes,
                changes: probe.changes,
            })
            .collect();
        asks.dedup_by(|next, last| next.bytes == last.bytes);
        asks
    }

    /// The kinds of the frames that answer requests, such as the names of messages. Messages that
    /// the device also sends [without a request](Self::is_unasked) are left out.
    pub fn reply_kinds(&self, heard: &Heard) -> Vec<String> {
        let probe = Probe::unasked();
        let frames = heard.frames.iter();
        let frames = frames.filter(|(_, frame)| !self.is_unasked(frame));
        let answers = frames.filter_map(|(latency, frame)| answer(self, &probe, *latency, frame));
        answers.map(|answer| answer.label).collect()
    }

    /// Whether the device sends the message of a frame without a request: after a delay,
    /// periodically, at its start, after a silence or at a break, or only at damaged frames.
    pub fn is_unasked(&self, frame: &Frame) -> bool {
        let Some(index) = self.index_of(frame) else {
            return false;
        };
        let sends = |fits: &dyn Fn(Trigger) -> bool| self.sends(index, fits);
        let comes_alone = |trigger| {
            use EventSpec::{Break, Start, Watchdog};
            matches!(trigger, Trigger::Event(Start | Watchdog | Break))
        };
        let is_damage = |trigger| trigger == Trigger::Event(EventSpec::BadFrame);
        let is_answer = |trigger| !comes_alone(trigger) && !is_damage(trigger);
        let later = self.after.iter().map(|after| &after.deed);
        let often = self.every.iter().map(|every| &every.deed);
        later.chain(often).any(|deed| deed.send.contains(&index))
            || sends(&comes_alone)
            || sends(&is_damage) && !sends(&is_answer)
    }

    /// Whether the device sends the message of a frame at an event, such as a refused access.
    pub(crate) fn is_at_event(&self, frame: &Frame) -> bool {
        let is_event = |trigger| matches!(trigger, Trigger::Event(_));
        self.index_of(frame)
            .is_some_and(|index| self.sends(index, &is_event))
    }

    /// Whether a request gets a reply by the description.
    pub fn has_replies(&self) -> bool {
        let is_request = |on: &&On| !matches!(on.trigger, Trigger::Event(_));
        let mut on = self.on.iter().filter(is_request);
        self.protocol.is_some() || on.any(|on| !on.deed.send.is_empty())
    }

    /// The names of the messages that answer damaged frames.
    pub fn damage_kinds(&self) -> Vec<&str> {
        let own = Trigger::Event(EventSpec::BadFrame);
        let on = self.on.iter().filter(|on| on.trigger == own);
        let sent = on.flat_map(|on| &on.deed.send);
        sent.map(|index| &*self.messages[*index].name).collect()
    }

    /// The index of the device's message in a frame.
    fn index_of(&self, frame: &Frame) -> Option<usize> {
        let body = self.body(frame).unwrap_or_default();
        let found = self.decode(frame.format, &body, From::Device);
        found.map(|(index, _)| index)
    }

    /// Whether an entry with such a trigger sends a message.
    fn sends(&self, message: usize, fits: &dyn Fn(Trigger) -> bool) -> bool {
        let mut on = self.on.iter().filter(|on| fits(on.trigger));
        on.any(|on| on.deed.send.contains(&message))
    }

    /// Whether a value may change without a request: it has a source, or a timer sets it.
    pub fn changes_with_time(&self) -> bool {
        let is_moving = |source: &Source| !matches!(source, Source::Stored | Source::Computed(_));
        let later = self.after.iter().map(|after| &after.deed);
        let mut deeds = self.every.iter().map(|every| &every.deed).chain(later);
        self.variables.iter().any(|one| is_moving(&one.source))
            || deeds.any(|deed| !deed.set.is_empty())
    }

    /// The time within which a reply begins and usually ends.
    pub fn reply_time(&self) -> Duration {
        patience(self)
    }

    /// The time from power-on until the device answers.
    pub fn boot_time(&self) -> Duration {
        self.boot.unwrap_or(Duration::ZERO)
    }
}
