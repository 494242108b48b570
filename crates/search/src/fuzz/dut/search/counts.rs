//! Findings and counts of a search so far.

use std::collections::BTreeMap;

use emulators::rng::Rng;

use super::Search;
use crate::fuzz::dut::finding::Kept;
use crate::fuzz::dut::plan::GivenUp;
use crate::fuzz::dut::probe::Probed;

impl Search<'_> {
    /// Number of failures that repetitions of the case did not confirm: failed checks, broken
    /// rules about time, and any failure in virtual time.
    pub const fn doubtful(&self) -> u64 {
        self.doubtful
    }

    /// Number of cases in which the rig was too late to judge checks.
    pub const fn late(&self) -> u64 {
        self.late
    }

    /// Errors that the program reported after altered input before it ended, with their numbers.
    pub const fn reported(&self) -> &BTreeMap<String, u64> {
        &self.reported
    }

    /// The conversations that the program ended by itself.
    pub const fn given_up(&self) -> GivenUp {
        self.given_up
    }

    /// The conversations whose time was over before half of their inputs were sent.
    pub const fn unfinished(&self) -> GivenUp {
        self.unfinished
    }

    /// The learned formats in words, by link.
    pub fn lessons(&self) -> impl Iterator<Item = (&str, String)> {
        let lessons = self
            .lessons
            .iter()
            .filter(|(_, (lesson, _))| !lesson.is_empty());
        lessons.map(|(at, (lesson, _))| (&*self.ends[*at].0.link, lesson.in_words()))
    }

    /// Whether the program sends requests on `link`, to which a device replies.
    pub fn asks(&self, link: &str) -> bool {
        let mut lessons = self.lessons.iter();
        lessons.any(|(at, (lesson, _))| self.ends[*at].0.link == link && lesson.asks())
    }

    /// Number of learned requests that the program answers on `link`, and whether damaged ones are
    /// sent: the checksum is certain.
    pub fn answers(&self, link: &str) -> (usize, bool) {
        let mut lessons = self.lessons.iter();
        let lesson = lessons.find(|(at, _)| self.ends[**at].0.link == link);
        lesson.map_or((0, false), |(_, (lesson, _))| {
            let is_damaged = !lesson.pairs(1, &mut Rng::stream(0, "answers")).is_empty();
            (lesson.answered().0, is_damaged)
        })
    }

    /// Number of the next case; cases of earlier searches count.
    pub const fn next(&self) -> u64 {
        self.state.next
    }

    /// The findings.
    pub fn findings(&self) -> &[Kept] {
        &self.state.findings
    }

    /// The observed behaviour of the program, by link.
    pub fn met(&self) -> impl Iterator<Item = &Probed> {
        self.met.values()
    }
}
