//! The page from the user's side: the command, its server, and a real browser.
//!
//! No test depends on the duration of an action: a test waits for an expected state, and compares
//! values at a virtual time at which the run is paused.

mod browser;
mod clock;
mod display;
mod hostile;
mod live;
mod log;
mod looks;
mod overlays;
mod past;
mod remote;
mod report;
mod server;
mod shows;
mod steers;

use std::path::Path;

use hilrig::run::Run;
use hilrig::scenario::Scenario;
use protocols::Instant;
use serde_json::{Value, json};

/// Repeats the run of a page from its case, up to `at_ns`.
fn again(case: &str, at_ns: u64) -> Run {
    let path = Path::new("<case>");
    let (scenario, source) = Scenario::parse(path, case.to_owned()).expect("a sound scenario");
    let mut run = Run::new(scenario, &source, None).expect("can be wired");
    run.go_on_until(Instant::from_nanos(at_ns));
    run
}

/// Converts all numbers to floating point, because a browser writes 1.0 as 1.
fn plain(value: Value) -> Value {
    match value {
        Value::Number(number) => json!(number.as_f64()),
        Value::Array(all) => all.into_iter().map(plain).collect(),
        Value::Object(all) => all
            .into_iter()
            .map(|(key, one)| (key, plain(one)))
            .collect(),
        other => other,
    }
}
