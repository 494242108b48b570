//! Verdicts of rules: observed value, time, and expectation.

use protocols::Instant;

use super::{PENDING_MAX, Rule, Seen};
use crate::robots::{Check, Status};
use crate::run::probe::Probe;
use crate::scenario::{Condition, Demand};

impl Rule {
    /// The verdict. If `is_over`, no condition can become true any more.
    pub(super) fn check(&self, now: Instant, is_over: bool) -> Check {
        let name = self.spec.check_name();
        let check = match self.demand {
            Demand::Always | Demand::Never => self.held(&name),
            Demand::Eventually if self.spec.after.is_some() => self.answered(&name, is_over),
            Demand::Eventually => self.came(&name, now, is_over),
            Demand::Sometimes => return self.reached(&name),
        };
        if let Some(missing) = self.probes.all().find_map(Probe::missing) {
            let detail = format!("{missing}; expected {}", self.spec);
            return Check::new(&name, false, detail);
        }
        let is_cut = self.probes.all().any(Probe::has_lost)
            || (self.seen.is_log_cut && self.conditions().any(Condition::is_of_log));
        if self.seen.is_overfull && check.status == Status::Pass {
            let detail = format!(
                "{}; more than {PENDING_MAX} triggers waited at once, each for an answer of its own",
                check.detail
            );
            return Check::not_observed(&name, detail);
        }
        // Moments may be missing because the log or the frames were cut.
        match (is_cut, check.status, self.demand) {
            (true, Status::Pass, _) | (true, Status::Fail, Demand::Eventually) => {
                let detail = format!("{}; the run kept only a part of the log", check.detail);
                Check::not_observed(&name, detail)
            }
            _ => check,
        }
    }

    fn conditions(&self) -> impl Iterator<Item = &Condition> {
        self.spec.conditions().map(|(_, condition)| condition)
    }

    fn held(&self, name: &str) -> Check {
        let (spec, seen) = (&self.spec, &self.seen);
        if let Some((at, words)) = &seen.broken {
            let more = in_all(seen.breaks);
            let detail = format!("at {at} s {words}; expected {spec}{more}");
            return Check::new(name, false, detail);
        }
        if let Some(why) = self.unobserved() {
            return Check::not_observed(name, format!("{why}; expected {spec}"));
        }
        let times = match &spec.after {
            None => String::new(),
            Some(_) => format!(", begun {}", times(seen.triggers)),
        };
        let held = match seen.moments {
            0 => "never came up".to_owned(),
            moments => format!("held at all of {moments} moments"),
        };
        Check::new(name, true, format!("{held}{times}: {spec}"))
    }

    /// The reason why an `always` or `never` was not observed; `None` if it was.
    fn unobserved(&self) -> Option<String> {
        let seen = &self.seen;
        if !seen.has_applied {
            return Some("the run ended before its time".to_owned());
        }
        if self.spec.after.is_some() && seen.triggers == 0 {
            return Some(self.no_trigger());
        }
        let is_whole = self.probes.subject.have_moments_appeared(seen.has_moved);
        if seen.moments > 0 && is_whole {
            return None;
        }
        // A condition that can only be true, such as an event, never reports a false moment. A
        // `never` on it counts as observed if the event could have happened.
        let could_come = self.demand == Demand::Never
            && self.probes.subject.has_appeared(seen.has_moved)
            && (self.spec.after.is_none() || seen.armed_since.is_some());
        if could_come {
            return None;
        }
        let silence = self.probes.subject.silence();
        Some(silence.unwrap_or_else(|| "nothing that the rule names appeared".to_owned()))
    }

    fn no_trigger(&self) -> String {
        let after = self.spec.after.as_ref();
        let silence = self.probes.after.as_ref().and_then(|after| after.silence());
        let silence = silence.map(|why| format!(" ({why})")).unwrap_or_default();
        let after = after.map(ToString::to_string).unwrap_or_default();
        format!("{after} did not come true{silence}")
    }

    fn answered(&self, name: &str, is_over: bool) -> Check {
        let (spec, seen) = (&self.spec, &self.seen);
        if let Some((at, words)) = &seen.broken {
            let more = in_all(seen.breaks);
            return Check::new(
                name,
                false,
                format!("by {at} s: {words}; expected {spec}{more}"),
            );
        }
        if seen.triggers == 0 {
            let why = match seen.has_applied {
                true => self.no_trigger(),
                false => "the run ended before its time".to_owned(),
            };
            return Check::not_observed(name, format!("{why}; expected {spec}"));
        }
        match (seen.pending.front(), spec.within) {
            (Some(asked), None) if is_over => {
                let detail = format!("asked at {asked} s, nothing until the end; expected {spec}");
                return Check::new(name, false, detail);
            }
            (Some(asked), _) if seen.answers == 0 => {
                let detail = format!("asked at {asked} s, the time is not up; expected {spec}");
                return Check::not_observed(name, detail);
            }
            _ => {}
        }
        let slowest = seen.slowest.map(|(took, at)| {
            format!("; the slowest after {:.3} s, at {at} s", took.as_secs_f64())
        });
        let slowest = slowest.unwrap_or_default();
        let answers = match seen.answers == seen.triggers {
            true => times(seen.answers),
            false => format!("{} of {}", times(seen.answers), seen.triggers),
        };
        Check::new(name, true, format!("{answers}{slowest}: {spec}")).if_observed(seen.answers > 0)
    }

    fn came(&self, name: &str, now: Instant, is_over: bool) -> Check {
        let (spec, seen) = (&self.spec, &self.seen);
        if let Some((at, words)) = &seen.met {
            return Check::new(name, true, format!("at {at} s {words}: {spec}"));
        }
        if !seen.has_applied && is_over {
            let detail = format!("the run ended before its time; expected {spec}");
            return Check::not_observed(name, detail);
        }
        let (_, until) = self.window();
        let is_late = until.is_some_and(|until| now > until);
        if !is_over && !is_late && !seen.is_over {
            return Check::not_observed(name, format!("has not become true yet; expected {spec}"));
        }
        let silence = self.probes.subject.silence();
        let silence = silence.map(|why| format!(" ({why})")).unwrap_or_default();
        let detail = format!("did not come true{silence}; expected {spec}");
        Check::new(name, false, detail)
    }

    fn reached(&self, name: &str) -> Check {
        let (spec, Seen { met, .. }) = (&self.spec, &self.seen);
        match met {
            Some((at, words)) => Check::new(name, true, format!("at {at} s {words}: {spec}")),
            None => {
                let detail =
                    format!("not reached in this run, which can happen in a single run: {spec}");
                Check::not_observed(name, detail)
            }
        }
    }
}

/// `once`, `12 times`.
fn times(count: u64) -> String {
    match count {
        1 => "once".to_owned(),
        count => format!("{count} times"),
    }
}

/// The total number of breaks, for a message about the first one; empty for a single break.
fn in_all(breaks: u64) -> String {
    match breaks {
        0 | 1 => String::new(),
        breaks => format!("; {breaks} times in all"),
    }
}
