//! A program and faults that are what a test wants, for the checkers of safety.

use firmware_core::map_view::MapView;
use firmware_core::memory::StrayWrites;
use firmware_core::pose::Pose;
use firmware_core::{Inspect, Master, Work};
use protocols::{Instant, LineConfig, Port};

use super::super::Checker;
use crate::rig::Rig;
use crate::scenario::{DirectionSpec, FaultKind, FaultSpec, Scenario, Source, Span};

/// A program that shows these values and sends these bytes.
#[derive(Clone, Default)]
pub(in crate::run) struct Puppet {
    pub(in crate::run) mode: &'static str,
    pub(in crate::run) counters: Vec<(&'static str, u64)>,
    pub(in crate::run) estimate: Option<(Instant, Pose)>,
    pub(in crate::run) stray: Option<StrayWrites>,
    pub(in crate::run) is_dead: bool,
}

impl Master for Puppet {
    fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}

    fn poll(&mut self, _: Instant) {}

    fn transmit(&mut self, _: Port, _: &mut [u8]) -> usize {
        0
    }

    fn poll_at(&self) -> Option<Instant> {
        None
    }

    fn line_config(&self, _: Port) -> LineConfig {
        LineConfig::new_8n1(1_000_000)
    }

    fn take_work(&mut self) -> Work {
        Work::NONE
    }
}

impl Inspect for Puppet {
    fn estimate(&self) -> Option<(Instant, Pose)> {
        self.estimate
    }

    fn map(&self) -> Option<MapView<'_>> {
        None
    }

    fn mode(&self) -> &'static str {
        self.mode
    }

    fn stray_writes(&self, report: &mut dyn FnMut(&'static str, StrayWrites)) {
        if let Some(stray) = self.stray {
            report("reply buffer", stray);
        }
    }

    fn is_dead(&self) -> bool {
        self.is_dead
    }

    fn counters(&self, report: &mut dyn FnMut(&'static str, u64)) {
        for &(name, value) in &self.counters {
            report(name, value);
        }
    }
}

/// The program of `rig`, which is added at the first call.
pub(in crate::run) fn puppet(rig: &mut Rig) -> &mut Puppet {
    if rig.program().is_none() {
        rig.add_program("program", Box::new(Puppet::default()));
    }
    rig.program_as_mut().expect("it was added")
}

/// A rescue robot of 60 s, with further tables.
pub(in crate::run) fn scenario(more: &str) -> (Scenario, Source) {
    let text = format!(
        "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"60s\"\n\
         [world]\nstart = {{ x_m = 1, y_m = 1, heading_deg = 0 }}\n{more}"
    );
    Scenario::from_text(&text).expect("sound")
}

/// Nothing arrives from the device of `link` between these seconds.
pub(in crate::run) fn cut(link: &str, from_s: u64, until_s: u64) -> FaultSpec {
    let second = |second| Some(Span::from_millis(1_000 * second));
    FaultSpec {
        from: second(from_s),
        until: second(until_s),
        ..FaultSpec::on(link, DirectionSpec::ToMaster, FaultKind::Cut)
    }
}

/// The verdict of a copy of `checker`, as text.
pub(in crate::run) fn copied(checker: &dyn Checker, rig: &Rig) -> String {
    let mut rig = rig.fork().expect("it has no node programs");
    let copy = checker.fork(&mut rig).expect("each can be copied");
    copy.verdict().to_string()
}
