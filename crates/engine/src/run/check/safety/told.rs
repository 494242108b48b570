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
        // A steady value had its true value also before the first update.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn watched() -> Watched {
        Watched {
            name: "the battery, V",
            truths: VecDeque::new(),
            told_at: None,
            reports: 0,
            wrong: 0,
            broken: None,
        }
    }

    fn figure(at_ms: u64, told: f64, truth: f64, wrong_min: u32) -> Figure {
        Figure {
            name: "the battery, V",
            at: Instant::from_millis(at_ms),
            told,
            truth,
            tolerance: 0.5,
            wrong_min,
        }
    }

    fn take(one: &mut Watched, millis: u64, told: f64, truth: f64) {
        let figure = figure(millis, told, truth, 3);
        one.take(Instant::from_millis(millis), &figure, true);
    }

    /// A report may be as old as 1.5 s: the value of that time counts as well as those since.
    #[test]
    fn a_report_agrees_with_a_recent_value() {
        let after = |age: u64| {
            let mut one = watched();
            take(&mut one, 0, 0.0, 10.0);
            take(&mut one, age, 9.5, 12.0);
            (one.reports, one.wrong)
        };
        assert_eq!((after(1_500), after(1_501)), ((1, 0), (1, 1)));
        let told = |told| {
            let mut one = watched();
            take(&mut one, 0, 0.0, 10.0);
            take(&mut one, 100, told, 12.0);
            one.wrong
        };
        assert_eq!([9.49, 9.5, 11.0, 12.5, 12.51].map(told), [1, 0, 0, 0, 1]);
    }

    /// Three wrong reports in a row; the same report counts once, and a right report in between, or
    /// a fault, restarts the count. A steady value fails at once.
    #[test]
    fn wrong_reports_in_a_row_fail() {
        let mut one = watched();
        take(&mut one, 0, 0.0, 10.0);
        for millis in [100, 200] {
            take(&mut one, millis, 8.0, 10.0);
            take(&mut one, millis, 8.0, 10.0);
        }
        assert_eq!((one.reports, one.wrong, one.broken), (2, 2, None));
        take(&mut one, 300, 10.0, 10.0);
        assert_eq!(one.wrong, 0);
        for millis in [400, 500] {
            take(&mut one, millis, 8.0, 10.0);
        }
        one.take(Instant::from_millis(600), &figure(600, 8.0, 10.0, 3), false);
        assert_eq!((one.wrong, one.reports), (0, 5));
        for millis in [700, 800, 900, 1_000] {
            take(&mut one, millis, 8.0, 10.0);
        }
        assert_eq!(one.broken, Some((Instant::from_millis(900), 8.0, 10.0)));
        let mut steady = watched();
        steady.take(Instant::from_millis(5), &figure(5, 8.0, 10.0, 1), true);
        assert!(steady.broken.is_some());
    }

    /// Two figures of a robot, of which the second one is wrong; each is judged by itself.
    #[test]
    fn each_figure_is_judged_by_itself() {
        use super::super::puppet::{copied, cut, scenario};
        use super::super::tests::look_at;
        use crate::robots::checker::Status;
        struct Robot(f64);
        impl Instruments for Robot {
            fn figures(&self, rig: &Rig) -> Vec<Figure> {
                let at = rig.now().as_millis();
                let speed = Figure {
                    name: "the speed, m/s",
                    ..figure(at, self.0, 10.0, 3)
                };
                vec![figure(at, 10.0, 10.0, 3), speed]
            }
        }
        let judged = |told: f64, fault: Option<FaultSpec>| {
            let (mut rig, _) = crate::rig::bare::linked(["radio"], 1_000_000);
            let calm = Calm::of(&scenario("").0, &rig, &|_| true);
            let mut checker = TelemetryTrue::new(Arc::new(Robot(told)), calm);
            let none = checker.verdict();
            assert_eq!(none.detail, "the robot reports no figures");
            checker.faults_changed(&fault.into_iter().collect::<Vec<_>>(), &rig);
            for tenth in 10..=14 {
                look_at(&mut checker, &mut rig, 100 * tenth, 0.0);
            }
            let check = checker.verdict();
            assert_eq!(copied(&checker, &rig), check.to_string());
            (check.status, check.detail)
        };
        // The first of five reports of each has no earlier value.
        assert_eq!(
            judged(10.5, None),
            (Status::Pass, "8 reported figures agree".to_owned())
        );
        let wrong = "at 1.300000 s the speed, m/s is reported as 8.00, the true value is 10.00";
        assert_eq!(judged(8.0, None), (Status::Fail, wrong.to_owned()));
        assert_eq!(judged(8.0, Some(cut("radio", 1, 2))).0, Status::NotObserved);
    }
}
