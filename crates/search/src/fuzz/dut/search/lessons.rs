//! Learning about a link, before the cases of a search.

use core::time::Duration;
use std::collections::BTreeSet;
use std::sync::Arc;

use description::{Description, From};

use super::Search;
use crate::fuzz::dut::case::{Known, has_echo};
use crate::fuzz::dut::harness::HarnessError;
use crate::fuzz::dut::learn::Asked;
use crate::fuzz::dut::learn::Lesson;
use crate::fuzz::dut::plan::RECORDINGS;
use crate::fuzz::dut::speech::Speech;
use crate::learn::{DescribedFormat, Directions, Gathered, conversation, without_echo};
use capture::Capture;

/// Minimum duration of the conversation that is used for learning.
const LESSON: Duration = Duration::from_secs(3);

impl Search<'_> {
    /// Learns the data of the device on the end with this number, without faults.
    pub(super) fn learn(&mut self, at: usize) -> Result<(), HarnessError> {
        let link = self.ends[at].0.link.clone();
        let (recording, plan) = (self.recording(), &self.plan);
        let lasting = plan.lasting.max(LESSON);
        let (met, case, seen) = self.harness.meet(&plan.scenario, lasting, &recording)?;
        let of_link = |of: &Option<String>| of.as_ref().is_none_or(|of| *of == link);
        let described = plan.descriptions.iter().filter(|(of, _)| of_link(of));
        let described: Vec<_> = described.map(|(_, one)| one.clone()).collect();
        let constants = self.harness.constants.get().cloned().unwrap_or_default();
        let (gathered, asked) = self.gather(&link, &described)?;
        let lesson = Arc::new(Lesson::of(gathered, asked, described, constants));
        let mut lessons = self.harness.lessons.borrow_mut();
        lessons.insert(link, lesson.clone());
        drop(lessons);
        // The program's output depends on its input.
        let known = Known {
            speaks: BTreeSet::new(),
            ..met.known
        };
        self.lessons.insert(at, (lesson, known));
        self.keep(case, &Speech::Bytes, seen)
    }

    /// The data about `link`: of the recorded first run, and of the corpus in the role that the
    /// program has in it. A program that sends no requests may answer them.
    fn gather(
        &self,
        link: &str,
        described: &[Arc<Description>],
    ) -> Result<(Gathered, Asked), HarnessError> {
        let plan = &self.plan;
        let capture = Capture::read(&self.recording());
        let mut spoken = capture.map_or_else(|_| Vec::new(), |one| conversation(&one, Some(link)));
        if has_echo(&plan.scenario, link) {
            spoken = without_echo(spoken);
        }
        let mut gathered = Gathered::default();
        let device = plan.scenario.device.get(link);
        let is_polled = device.is_some_and(|device| device.kind() == "master");
        match is_polled {
            true => gathered.questions(&spoken),
            false => gathered.conversation(&spoken),
        }
        let corpus = plan.corpus.as_ref();
        let mut asked = Asked::default();
        if gathered.has_requests() {
            asked.roles = corpus.map_or_else(Vec::new, |corpus| corpus.roles(link, &gathered));
        } else {
            let mut sources = corpus.map_or_else(Vec::new, |corpus| corpus.sides(link));
            if is_polled {
                sources.push(Directions {
                    to_master: gathered.questions_so_far().to_vec(),
                    ..Directions::default()
                });
            } else if !described.is_empty() {
                let examples = |from| {
                    let format = DescribedFormat::of_wire(described, from);
                    format.map_or_else(Vec::new, |format| format.examples())
                };
                let [to_device, to_master] = [From::Host, From::Device].map(examples);
                sources.push(Directions {
                    to_device,
                    to_master,
                });
            }
            let recording = &plan.out.join(RECORDINGS[2]);
            asked = self
                .harness
                .ask_both(&plan.scenario, link, &sources, recording)?;
        }
        if let Some(corpus) = corpus {
            corpus.teach(link, &asked.roles, &mut gathered);
        }
        Ok((gathered, asked))
    }
}
