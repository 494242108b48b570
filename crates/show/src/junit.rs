//! Verdicts as JUnit XML, which every CI displays.

use core::time::Duration;

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use engine::TOOL;
use engine::run::Outcome;
use engine::run::check::{Check, Status};

/// Verdicts of one run or case.
#[derive(Clone, Debug)]
pub struct Suite<'a> {
    /// Name of the scenario or case.
    pub name: &'a str,
    /// Seed of the run, if it had one.
    pub seed: Option<u64>,
    /// All verdicts.
    pub checks: &'a [Check],
    /// Names of checks that count as failed if they were not observed.
    pub unproved: Vec<&'a str>,
    /// The command that repeats the run.
    pub again: Option<&'a str>,
    /// The probable cause, if the program under test failed.
    pub probable_cause: Option<&'a str>,
}

impl<'a> From<&'a Outcome> for Suite<'a> {
    fn from(outcome: &'a Outcome) -> Self {
        Self {
            name: &outcome.case.name,
            seed: Some(outcome.seed),
            checks: &outcome.checks,
            unproved: match outcome.is_judged() {
                true => outcome.unobserved_rules().map(|one| &*one.name).collect(),
                false => outcome.checks.iter().map(|one| &*one.name).collect(),
            },
            again: outcome.again.as_deref(),
            probable_cause: outcome.probable_cause.as_deref(),
        }
    }
}

/// The verdicts of `suites` as JUnit XML: one suite per run, one test case per check. `wall` is the
/// total wall time.
pub fn junit<'a>(suites: impl IntoIterator<Item = Suite<'a>>, wall: Duration) -> String {
    let mut report = Report::new(TOOL);
    report.set_time(wall);
    for Suite {
        name,
        seed,
        checks,
        unproved,
        again,
        probable_cause,
    } in suites
    {
        let mut suite = TestSuite::new(match seed {
            Some(seed) => format!("{name} seed {seed}"),
            None => name.to_owned(),
        });
        for check in checks {
            let status = match check.status {
                Status::Pass => TestCaseStatus::success(),
                Status::NotObserved => {
                    let mut status = match unproved.contains(&&*check.name) {
                        true => TestCaseStatus::non_success(NonSuccessKind::Failure),
                        false => TestCaseStatus::skipped(),
                    };
                    status.set_message(format!("not observed: {}", check.detail));
                    status
                }
                Status::Fail => {
                    let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
                    let cause = probable_cause.map(|cause| format!("; probable cause: {cause}"));
                    status.set_message(check.detail.clone() + &cause.unwrap_or_default());
                    if let Some(again) = again {
                        status.set_description(format!("again: {again}"));
                    }
                    status
                }
            };
            let mut case = TestCase::new(check.name.clone(), status);
            case.set_classname(name.to_owned());
            suite.add_test_case(case);
        }
        report.add_test_suite(suite);
    }
    report.to_string().expect("written to memory")
}
