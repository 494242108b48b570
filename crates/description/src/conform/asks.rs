//! The requests of a description for other tests of a device, and their effect on it.

use core::time::Duration;

use protocols::Decode as _;

use super::probes::{self, Probe};
use super::{answer, patience};
use crate::behaviour::{On, Trigger};
use crate::description::Description;
use crate::framing::Frame;
use crate::peer::Heard;
use crate::schema::message::From;

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

/// Modbus functions that only read.
const READS: core::ops::RangeInclusive<u8> = 1..=4;

impl Description {
    /// All requests that a [comparison](super::conform) sends, without damaged ones.
    pub fn asks(&self) -> Vec<Ask> {
        let probes = probes::of(self).into_iter();
        let asks = probes.filter(|probe| probe.asks.is_some() && !probe.bytes.is_empty());
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

    /// Whether `bytes`, which a pause ends, leave the state of a device unchanged: all frames in
    /// them are known requests without an effect. Without a checksum the device cannot detect
    /// damage, so that no byte may be outside of a frame.
    pub fn is_harmless(&self, bytes: &[u8]) -> bool {
        if self.ends_with_silence() {
            let all = self.whole(bytes);
            return all.map_or(self.is_checked(), |frame| self.leaves_state(&frame));
        }
        let mut cutter = self.cutter_of(From::Host);
        let mut found: Vec<_> = cutter.push(bytes).collect();
        let is_whole = cutter.pending() == 0 && cutter.discarded() == 0;
        cutter.idle();
        found.extend(cutter.push(&[]));
        let frames = found.iter().flatten();
        (self.is_checked() || is_whole) && { frames }.all(|frame| self.leaves_state(frame))
    }

    /// Whether all requests have a checksum.
    fn is_checked(&self) -> bool {
        let formats = self.frames_of(From::Host);
        let mut used = (0..self.formats()).filter(|format| formats.looks_for(*format));
        used.all(|format| !self.frames.0[format].checks.is_empty())
    }

    fn leaves_state(&self, frame: &Frame) -> bool {
        let Some(body) = self.body(frame) else {
            return false;
        };
        if self.protocol.is_some() {
            return body.get(1).is_some_and(|function| READS.contains(function));
        }
        let known = self.decode(frame.format, &body, From::Host);
        known.is_some_and(|(index, _)| !probes::changes(self, index))
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

    /// The time within which a reply begins and usually ends.
    pub fn reply_time(&self) -> Duration {
        patience(self)
    }

    /// The time from power-on until the device answers.
    pub fn boot_time(&self) -> Duration {
        self.boot.unwrap_or(Duration::ZERO)
    }
}
