//! Checks the figures that the robot reports to its station.

use core::time::Duration;
use std::collections::VecDeque;
use std::sync::Arc;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use crate::rig::Rig;
use crate::robots::{Figure, Instruments};
use crate::scenario::FaultSpec;

/// Maximum age of a figure: the search for the pose, the queue and the radio.
const AGE: Duration = Duration::from_millis(1_500);

/// The figures that the robot reported equal its true ones at that time.
#[derive(Clone)]
pub struct TelemetryTrue {
    instruments: Arc<dyn Instruments>,
    calm: Calm,
    watched: Vec<Watched>,
}

#[derive(Clone, Debug)]
struct Watched {
    name: &'static str,
    /// Recent true values.
    truths: VecDeque<(Instant, f64)>,
    told_at: Option<Instant>,
    reports: u64,
    wrong: u32,
    broken: Option<(Instant, f64, f64)>,
}

impl TelemetryTrue {
    /// Observes the figures of `instruments` while the links of its station and its drive are
    /// `calm`: a fault may delay a report by many seconds.
    pub const fn new(instruments: Arc<dyn Instruments>, calm: Calm) -> Self {
        Self {
            instruments,
            calm,
            watched: Vec::new(),
        }
    }

    fn take(&mut self, now: Instant, figure: &Figure) {
        let index = self.watched.iter().position(|one| one.name == figure.name);
        let index = index.unwrap_or_else(|| {
            self.watched.push(Watched {
                name: figure.name,
                truths: VecDeque::new(),
                told_at: None,
                reports: 0,
                wrong: 0,
                broken: None,
            });
            self.watched.len() - 1
        });
        let is_calm = self.calm.is(now);
        self.watched[index].take(now, figure, is_calm);
    }
}

impl Watched {
    fn take(&mut self, now: Instant, figure: &Figure, is_calm: bool) {
        self.truths.push_back((now, figure.truth));
        let is_old = |&(at, _): &(Instant, f64)| now - at > AGE;
        while self.truths.front().is_some_and(is_old) {
            self.truths.pop_front();
        }
        // A report before the first update has no true value to compare with.
        let is_new = self.told_at != Some(figure.at);
        let was_told = self.told_at.replace(figure.at).is_some();
        // A steady value has had its true value before, too.
        let is_steady = figure.wrong_min == 1;
        if !is_new || !(was_told || is_steady) {
            return;
        }
        if !is_calm {
            self.wrong = 0;
            return;
        }
        self.reports += 1;
        let truths = || self.truths.iter().map(|&(_, truth)| truth);
        let least = truths().fold(f64::INFINITY, f64::min) - figure.tolerance;
        let most = truths().fold(f64::NEG_INFINITY, f64::max) + figure.tolerance;
        if (least..=most).contains(&figure.told) {
            self.wrong = 0;
            return;
        }
        self.wrong += 1;
        if self.wrong >= figure.wrong_min && self.broken.is_none() {
            self.broken = Some((now, figure.told, figure.truth));
        }
    }
}

impl Checker for TelemetryTrue {
    fn observe(&mut self, look: &Look<'_>) {
        let now = look.rig.now();
        let figures = Arc::clone(&self.instruments).figures(look.rig);
        for figure in &figures {
            self.take(now, figure);
        }
    }

    fn verdict(&self) -> Check {
        let name = "telemetry-true";
        let broken = self.watched.iter().find_map(|one| Some((one, one.broken?)));
        let reports: u64 = self.watched.iter().map(|one| one.reports).sum();
        let detail = match broken {
            Some((one, (at, told, truth))) => {
                format!(
                    "at {at} s {} is reported as {told:.2}, the true value is {truth:.2}",
                    one.name
                )
            }
            None if self.watched.is_empty() => "the robot reports no figures".to_owned(),
            None => format!("{reports} reported figures agree"),
        };
        Check::new(name, broken.is_none(), detail).if_observed(reports > 0)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        self.calm.renew(faults, rig);
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}
