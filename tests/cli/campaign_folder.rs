//! Folders of campaigns made by hand, with known results.

use core::ops::Range;

use serde_json::{Value, json};

use super::Session;

/// The line of a run that failed for `cause`, or passed.
pub(crate) fn line(scenario: &str, seed: u64, cause: Option<&str>) -> String {
    // The keys are in the order in which the tool writes them: a cut line must be recognised as
    // cut.
    let detail = cause.map_or(Value::Null, |cause| json!(format!("{cause}: 42 times")));
    let cause = cause.map_or(Value::Null, Value::from);
    format!(
        "{{\"scenario\":\"{scenario}\",\"seed\":{seed},\"cause\":{cause},\"detail\":{detail},\
         \"ran_ms\":2000,\"trace\":\"{seed:016x}\",\"reached\":[]}}\n"
    )
}

/// A campaign of some scenarios, which are their names only.
pub(crate) struct Folder<'a> {
    pub(crate) scenarios: &'a [(&'a str, &'a str)],
    pub(crate) seeds: Range<u64>,
    pub(crate) vary: &'a str,
}

impl Folder<'_> {
    /// Writes the folder `dir` with `runs`: scenario, seed, cause.
    pub(crate) fn write(&self, session: &Session, dir: &str, runs: &[(&str, u64, Option<&str>)]) {
        std::fs::create_dir_all(session.path(dir)).expect("room");
        let texts = self.scenarios.iter();
        let texts = texts.map(|&(name, text)| (name.to_owned(), Value::from(text)));
        let plan = json!({
            "tool": "hilrig 0.0.9",
            "scenarios": Value::Object(texts.collect()),
            "seeds": { "start": self.seeds.start, "end": self.seeds.end },
            "vary": self.vary,
        });
        session.write(&format!("{dir}/plan.json"), &plan.to_string());
        let lines = runs.iter();
        let lines = lines.map(|(scenario, seed, cause)| line(scenario, *seed, *cause));
        session.write(&format!("{dir}/runs.jsonl"), &lines.collect::<String>());
    }
}
