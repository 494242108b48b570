//! Verdicts as JUnit XML, which every CI displays.

use core::time::Duration;
use std::path::Path;

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use engine::TOOL;
use engine::run::Outcome;
use engine::run::check::{Check, Status};

/// Verdicts of one run or case.
#[derive(Clone, Debug)]
pub struct Suite<'a> {
    /// Name of the scenario or case.
    pub name: &'a str,
    /// Its file. It tells suites of equal names apart.
    pub file: Option<&'a Path>,
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
            file: None,
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

/// The names of `suites`, each different from all others: equal names get their files, and equal
/// files numbers. Many tools merge suites of one name, so verdicts would get lost.
fn names(suites: &[Suite<'_>]) -> Vec<String> {
    let mut taken: Vec<String> = Vec::new();
    for suite in suites {
        let is_same = |other: &&Suite<'_>| other.name == suite.name && other.file != suite.file;
        let is_twin = |other: &&Suite<'_>| (other.name, other.seed) == (suite.name, suite.seed);
        let is_alone = !suites.iter().any(|other| is_same(&other))
            && suites.iter().filter(is_twin).count() == 1;
        let name = match suite.file.filter(|_| !is_alone) {
            Some(file) => format!("{} ({})", suite.name, file.display()),
            None => suite.name.to_owned(),
        };
        let seeded = |name: &str| match suite.seed {
            Some(seed) => format!("{name} seed {seed}"),
            None => name.to_owned(),
        };
        let numbered = (2..).map(|number| seeded(&format!("{name} {number}")));
        let mut all = core::iter::once(seeded(&name)).chain(numbered);
        taken.extend(all.find(|name| !taken.contains(name)));
    }
    taken
}

/// The classes of the test cases of each suite: its name without the seed, if no other suite has
/// the same. Tools that know no suites tell test cases apart by class and name.
fn classes(suites: &[Suite<'_>], names: &[String]) -> Vec<String> {
    let plain = |(suite, name): (&Suite<'_>, &String)| {
        let end = suite
            .seed
            .map_or(String::new(), |seed| format!(" seed {seed}"));
        name.strip_suffix(&end).unwrap_or(name).to_owned()
    };
    let plain: Vec<String> = suites.iter().zip(names).map(plain).collect();
    let each = plain.iter().zip(names).map(|(class, name)| {
        match plain.iter().filter(|other| *other == class).count() {
            1 => class.clone(),
            _ => name.clone(),
        }
    });
    each.collect()
}

/// The verdicts of `suites` as JUnit XML: one suite per run, one test case per check. `wall` is the
/// total wall time.
pub fn junit<'a>(suites: impl IntoIterator<Item = Suite<'a>>, wall: Duration) -> String {
    let mut report = Report::new(TOOL);
    report.set_time(wall);
    let suites: Vec<Suite<'_>> = suites.into_iter().collect();
    let names = names(&suites);
    let classes = classes(&suites, &names);
    for ((suite, suite_name), class) in suites.into_iter().zip(names).zip(classes) {
        let Suite {
            checks,
            unproved,
            again,
            probable_cause,
            ..
        } = suite;
        let mut suite = TestSuite::new(suite_name);
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
            case.set_classname(class.clone());
            suite.add_test_case(case);
        }
        report.add_test_suite(suite);
    }
    report.to_string().expect("written to memory")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cases of one name in two folders, one of them given twice, and a scenario with two seeds.
    #[test]
    fn each_suite_has_a_name_of_its_own() {
        let checks = [Check::new("lives", true, "to the end")];
        let suite = |name, file: &'static str, seed| Suite {
            name,
            file: Some(Path::new(file)),
            seed,
            checks: &checks,
            unproved: Vec::new(),
            again: None,
            probable_cause: None,
        };
        let suites = [
            suite("case", "a/case.toml", None),
            suite("case", "b/case.toml", None),
            suite("case", "b/case.toml", None),
            suite("other", "a/other.toml", None),
            suite("flat", "flat.toml", Some(1)),
            suite("flat", "flat.toml", Some(2)),
            suite("room", "a/room.toml", Some(1)),
            suite("room", "b/room.toml", Some(2)),
            suite("hall", "hall.toml", Some(7)),
        ];
        let expected = [
            "case (a/case.toml)",
            "case (b/case.toml)",
            "case (b/case.toml) 2",
            "other",
            "flat seed 1",
            "flat seed 2",
            "room (a/room.toml) seed 1",
            "room (b/room.toml) seed 2",
            "hall seed 7",
        ];
        assert_eq!(names(&suites), expected);
        let text = junit(suites, Duration::ZERO);
        // A test case is its class and its name: each check has the same name here.
        for class in [
            "case (b/case.toml)",
            "case (b/case.toml) 2",
            "flat seed 1",
            "flat seed 2",
            "room (a/room.toml)",
            "room (b/room.toml)",
            "hall",
        ] {
            let times = text.matches(&format!("classname=\"{class}\"")).count();
            assert_eq!(times, 1, "{class}: {text}");
        }
    }
}
