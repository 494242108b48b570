//! The page as a user meets it: the command, its server, and a real browser in front of it.
//!
//! Nothing here depends on how long something takes: a test waits for what it expects, and what
//! it compares, it compares at a virtual time at which the run stands still.

mod browser;
mod clock;
mod display;
mod hostile;
mod live;
mod log;
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

/// The run that a page showed, done again from its case, up to `at_ns`.
fn again(case: &str, at_ns: u64) -> Run {
    let path = Path::new("<case>");
    let (scenario, source) = Scenario::parse(path, case.to_owned()).expect("a sound scenario");
    let mut run = Run::new(scenario, &source, None).expect("can be wired");
    run.go_on_until(Instant::from_nanos(at_ns));
    run
}

/// A browser tells 1.0 as 1: all numbers alike.
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
