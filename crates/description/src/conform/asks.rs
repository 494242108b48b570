//! The requests of a description for other tests of a device, and their effect on it.

use core::time::Duration;

use super::probes::{self, Probe};
use super::{answer, patience};
use crate::behaviour::{On, Trigger};
use crate::description::Description;
use crate::framing::Frame;
use crate::peer::Heard;
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
    /// the device also sends after a delay, periodically, or at an event are left out.
    pub fn reply_kinds(&self, heard: &Heard) -> Vec<String> {
        let probe = Probe::unasked();
        let frames = heard.frames.iter();
        let frames = frames.filter(|(_, frame)| !self.is_unasked(frame));
        let answers = frames.filter_map(|(latency, frame)| answer(self, &probe, *latency, frame));
        answers.map(|answer| answer.label).collect()
    }

    /// Whether the device also sends the message of a frame after a delay, periodically, or at an
    /// event.
    pub fn is_unasked(&self, frame: &Frame) -> bool {
        let body = self.body(frame).unwrap_or_default();
        let Some((index, _)) = self.decode(frame.format, &body, From::Device) else {
            return false;
        };
        let is_event = |on: &&On| matches!(on.trigger, Trigger::Event(_));
        let events = self.on.iter().filter(is_event).map(|on| &on.deed);
        let later = self.after.iter().map(|after| &after.deed);
        let often = self.every.iter().map(|every| &every.deed);
        let mut deeds = events.chain(later).chain(often);
        deeds.any(|deed| deed.send.contains(&index))
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
