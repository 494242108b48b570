//! What `--json` prints: one object for each command, with what it came to in `result`.
//! `hilrig schema --output` prints its schema. New keys may come; [`FORMAT`] changes when one is
//! taken away or means something else.

mod case;
mod described;
mod experiment;

use schemars::generate::{SchemaGenerator, SchemaSettings};
use schemars::{JsonSchema, Schema, json_schema};
use serde::Serialize;
use serde_json::{Value, json};

pub(super) use case::{CaseChecked, CaseMade, CaseTry};
pub(super) use described::{
    ClaimTold, Conformed, DifferenceTold, Exchanged, Learned, RepliedWith, Talked, ValueTold,
};
pub(super) use experiment::{ExperimentDone, ExperimentFigure, Experiments};

use super::{CliError, Verdict};
use crate::TOOL;
use crate::robots::checker::{Check, Status};
use crate::show::folder::Metrics;

/// Version of what is printed.
const FORMAT: u32 = 1;

/// How a command ended.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum End {
    /// Everything held.
    Pass,
    /// An expectation failed.
    Fail,
    /// One failed while the rig was too late to tell why.
    NotJudged,
    /// A signal ended it.
    Interrupted,
    /// It could not do its work; `error` says why.
    Error,
}

/// The object of a command that ended with `exit_code`.
pub(super) fn document(
    command: &str,
    ended: &Result<Verdict, CliError>,
    exit_code: u8,
    result: Option<Value>,
) -> Value {
    let end = match ended {
        Ok(Verdict::Pass | Verdict::Program(0)) => End::Pass,
        Ok(Verdict::Fail | Verdict::Program(_)) => End::Fail,
        Ok(Verdict::NotJudged) => End::NotJudged,
        Ok(Verdict::Interrupted(_)) => End::Interrupted,
        Err(_) => End::Error,
    };
    json!({
        "tool": TOOL,
        "version": env!("CARGO_PKG_VERSION"),
        "format": FORMAT,
        "command": command,
        "verdict": end,
        "exit_code": exit_code,
        "error": ended.as_ref().err().map(ToString::to_string),
        "result": result,
    })
}

/// The schema of a command's result.
type Subschema = fn(&mut SchemaGenerator) -> Schema;

fn of<T: JsonSchema>(generator: &mut SchemaGenerator) -> Schema {
    generator.subschema_for::<T>()
}

/// Of commands that write files, or print what would stand in one.
fn files_or_text(generator: &mut SchemaGenerator) -> Schema {
    let forms = [of::<Files>(generator), of::<Text>(generator)];
    json_schema!({ "anyOf": forms })
}

/// Of the command that makes cases, and runs them.
fn made_or_checked(generator: &mut SchemaGenerator) -> Schema {
    let forms = [of::<CaseMade>(generator), of::<CaseChecked>(generator)];
    json_schema!({ "anyOf": forms })
}

/// What the commands come to.
const RESULTS: [(&str, Subschema); 31] = [
    ("demo", of::<Runs>),
    ("run", of::<Runs>),
    ("up", of::<UpEnded>),
    ("dut", of::<DutEnded>),
    ("fault", of::<Faults>),
    ("with", of::<ProgramEnded>),
    ("ui", of::<UiEnded>),
    ("link", of::<LinkEnded>),
    ("record", of::<RecordEnded>),
    ("replay", of::<ReplayEnded>),
    ("case", made_or_checked),
    ("import", of::<Imported>),
    ("export", of::<Exported>),
    ("decode", of::<Decoded>),
    ("describe", files_or_text),
    ("learn", of::<Learned>),
    ("talk", of::<Talked>),
    ("conform", of::<Conformed>),
    ("bugs", of::<Bugs>),
    ("campaign", of::<CampaignEnded>),
    ("fuzz", of::<FuzzEnded>),
    ("shrink", of::<Shrunk>),
    ("fidelity", of::<Figures>),
    ("experiment", of::<Experiments>),
    ("slam", of::<Surveyed>),
    ("map", of::<MapDifference>),
    ("schema", of::<Text>),
    ("wireshark", files_or_text),
    ("completions", of::<Text>),
    ("man", files_or_text),
    ("new", of::<Files>),
];

/// The JSON Schema of what `--json` prints.
pub(super) fn json_schema() -> Value {
    let mut generator = SchemaSettings::draft2020_12().into_generator();
    let end = generator.subschema_for::<End>();
    let results: Vec<Value> = RESULTS
        .iter()
        .map(|(command, schema)| {
            let result = schema(&mut generator);
            json!({ "properties": {
                "command": { "const": command },
                "result": { "anyOf": [result, { "type": "null" }] },
            } })
        })
        .collect();
    let definitions = generator.take_definitions(true);
    let mut schema = json_schema!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "What a command of hilrig prints with --json",
        "type": "object",
        "properties": {
            "tool": { "const": TOOL },
            "version": { "type": "string" },
            "format": { "const": FORMAT },
            "command": { "type": "string" },
            "verdict": end,
            "exit_code": { "type": "integer" },
            "error": { "type": ["string", "null"] },
            "result": {},
        },
        "required": ["tool", "version", "format", "command", "verdict", "exit_code", "error", "result"],
        "oneOf": results,
    });
    schema.insert("$defs".to_owned(), Value::Object(definitions));
    schema.to_value()
}

/// Text that is itself the result.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Text {
    pub(super) text: String,
}

/// Files that were written.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Files {
    pub(super) files: Vec<String>,
}

/// Runs and cases that were judged.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(super) struct Runs {
    pub(super) runs: Vec<RunEnded>,
}

/// One of them.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct RunEnded {
    /// Name of the scenario or case.
    pub(super) name: String,
    /// None of a case of bytes.
    pub(super) seed: Option<u64>,
    pub(super) verdict: Status,
    pub(super) checks: Vec<Check>,
    /// The probable cause, if the foreign program failed.
    pub(super) probable_cause: Option<String>,
    /// None of a case of bytes.
    pub(super) metrics: Option<Metrics>,
    /// Fingerprint of all bytes.
    pub(super) trace_hash: Option<String>,
    /// Where its results are.
    pub(super) folder: Option<String>,
    /// The command that does it again, if it did not pass.
    pub(super) repeat: Option<String>,
}

/// A run in real time that was not judged, or judged by `--out`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct UpEnded {
    /// Rig time.
    pub(super) ran_s: f64,
    /// Ports that were used.
    pub(super) used: Vec<String>,
    /// Faults and orders that came by hand.
    pub(super) changed_by_hand: bool,
    /// The verdict, with `--out`.
    pub(super) judged: Option<RunEnded>,
}

/// The robot's program as a process.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct DutEnded {
    pub(super) ran_s: f64,
    /// The program's own counters, by name.
    pub(super) counters: std::collections::BTreeMap<String, u64>,
}

/// The end of a program on the ports of a running rig.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct ProgramEnded {
    /// Its exit code as a shell has it: 128 and its number for a signal.
    pub(super) program_exit_code: u8,
}

/// Faults of a running rig.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Faults {
    /// Number of the one that was added or ended.
    pub(super) id: Option<u64>,
    /// All of them, with `list`: `id`, `state`, `fault`.
    pub(super) faults: Option<Vec<Value>>,
}

/// A run on a page.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct UiEnded {
    /// Rig time; none with `--pc`.
    pub(super) ran_s: Option<f64>,
    /// Fingerprint of all bytes; none with `--pc`.
    pub(super) trace_hash: Option<String>,
}

/// A line between two ports, faults included.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct LinkEnded {
    /// The capture, if there is one.
    pub(super) file: Option<String>,
    pub(super) seed: u64,
    pub(super) ran_s: f64,
    pub(super) lines: Vec<LinePassed>,
}

/// One direction of it.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct LinePassed {
    pub(super) from: String,
    pub(super) to: String,
    pub(super) bytes_sent: u64,
    /// Bytes that came out of the line.
    pub(super) bytes_arrived: u64,
    pub(super) bytes_lost: u64,
    pub(super) bytes_added: u64,
    /// Characters without a valid stop bit.
    pub(super) framing_errors: u64,
    /// Bytes that came out while the port was closed.
    pub(super) bytes_unheard: u64,
    /// Bytes for which the port had no room.
    pub(super) bytes_overrun: u64,
}

/// A recording between ports.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct RecordEnded {
    pub(super) file: String,
    pub(super) ran_s: f64,
    pub(super) links: Vec<LinkRecorded>,
}

/// One of its links.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct LinkRecorded {
    pub(super) name: String,
    pub(super) bytes_to_master: u64,
    pub(super) bytes_to_device: u64,
    /// Bytes that came while the far end was closed.
    pub(super) bytes_lost: u64,
}

/// A capture that was played.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(super) struct ReplayEnded {
    pub(super) played_s: f64,
    /// Bytes played to the program.
    pub(super) bytes_sent: u64,
    /// Bytes from there.
    pub(super) bytes_back: u64,
    pub(super) checks: Vec<Check>,
    /// The first difference from the capture, with `--expect`.
    pub(super) divergence: Option<String>,
    pub(super) trace_hash: Option<String>,
}

/// A dump that became a capture.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Imported {
    pub(super) file: String,
    pub(super) format: String,
    pub(super) bytes: u64,
    pub(super) records: u64,
    /// What is worth knowing of the dump.
    pub(super) notes: Vec<String>,
}

/// A capture in another form.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Exported {
    pub(super) file: String,
    /// How much of what is in it.
    pub(super) holds: String,
}

/// What is in a capture.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(super) struct Decoded {
    /// What passed the lines, in the order of time; empty with `--summary` and `--diagnose`.
    pub(super) entries: Vec<EntryDecoded>,
    /// Each line as a whole.
    pub(super) lines: Vec<LineDecoded>,
}

/// A frame, text, bad bytes or an event.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct EntryDecoded {
    /// Since the capture began; none of a dump.
    pub(super) at_s: Option<f64>,
    pub(super) link: String,
    /// `to-master` or `to-device`.
    pub(super) direction: String,
    /// Place of the first byte on its line.
    pub(super) place: u64,
    /// In words.
    pub(super) said: String,
}

/// One direction of a link.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct LineDecoded {
    /// Link, and direction if there is one.
    pub(super) name: String,
    pub(super) bytes: u64,
    /// The one with the most sound frames.
    pub(super) protocol: Option<String>,
    /// Bytes in sound frames.
    pub(super) framed: u64,
    /// Figures of the device, in words.
    pub(super) figures: Option<String>,
    /// What was done to all bytes of it, with `--diagnose`.
    pub(super) damages: Vec<String>,
}

/// Defects of the fielded programs.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Bugs {
    /// Each with `id`, `place`, `sees`; a reproduced one with `defective`, `sound` and `holds`.
    pub(super) bugs: Vec<Value>,
}

/// What a campaign came to so far.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct CampaignEnded {
    pub(super) folder: String,
    pub(super) runs: u64,
    pub(super) failed: u64,
    /// Runs that no shard has done; none of a shard.
    pub(super) missing: Option<u64>,
    /// Fingerprint of all runs; none of a shard.
    pub(super) trace_hash: Option<String>,
    /// Failures by cause, the most frequent first.
    pub(super) causes: Vec<CauseFound>,
    /// Situations that never came up.
    pub(super) never_came_up: Vec<String>,
}

/// Runs that failed alike.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct CauseFound {
    pub(super) cause: String,
    /// What the first of them says.
    pub(super) detail: String,
    pub(super) runs: u64,
    /// Scenario and seed of the first.
    pub(super) first: (String, u64),
    /// The command that runs the minimised case.
    pub(super) repeat: Option<String>,
}

/// What a fuzzer found.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(super) struct FuzzEnded {
    pub(super) folder: String,
    /// Causes, earlier runs in the same folder included.
    pub(super) findings: u64,
    /// Each target; none with a foreign program.
    pub(super) targets: Vec<TargetFuzzed>,
}

/// One of its targets.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct TargetFuzzed {
    pub(super) name: String,
    pub(super) cases: u64,
    pub(super) behaviours: u64,
    pub(super) findings: u64,
}

/// A case that was made smaller.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Shrunk {
    pub(super) file: String,
    pub(super) cause: String,
    /// What is left, in words.
    pub(super) left: String,
    pub(super) tries: u64,
    /// The command that shows it.
    pub(super) repeat: String,
}

/// Figures of a device, beside those of another one.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Figures {
    pub(super) figures: Vec<FigureCompared>,
}

/// One of them.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct FigureCompared {
    pub(super) name: String,
    pub(super) unit: String,
    /// In the stream that is the measure.
    pub(super) real: Option<f64>,
    pub(super) emulated: Option<f64>,
    /// Whether they agree; none if that is not judged.
    pub(super) holds: Option<bool>,
}

/// A log that was mapped.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Surveyed {
    pub(super) folder: String,
    pub(super) scans: u64,
    pub(super) skipped: u64,
    pub(super) doubtful: u64,
    pub(super) ambiguous: u64,
    /// Scans that the mapper put far from where the wheels had.
    pub(super) jumps: u64,
    /// Places seen again.
    pub(super) loop_edges: u64,
    pub(super) cell_mm: f64,
    pub(super) scan_median_us: f64,
    pub(super) scan_longest_us: f64,
}

/// How two maps differ.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct MapDifference {
    pub(super) shift_mm: [f64; 2],
    pub(super) turn_deg: f64,
    /// In the mean.
    pub(super) wall_error_mm: f64,
    /// For 95 %.
    pub(super) wall_error_95_mm: f64,
    /// Part of A's walls that is in B.
    pub(super) first_in_second: f64,
    /// Part of B's walls that is in A.
    pub(super) second_in_first: f64,
    /// Part of the cells that both know and have alike.
    pub(super) alike: f64,
}
