//! The output of `--json`: one object for each command, with its result in `result`. `hilrig schema
//! --output` prints its schema. New keys may be added; [`FORMAT`] changes when a key is removed or
//! changes its meaning.

mod bench;
mod campaign;
mod case;
mod described;
mod experiment;
mod fidelity;

use schemars::generate::{SchemaGenerator, SchemaSettings};
use schemars::{JsonSchema, Schema, json_schema};
use serde::Serialize;
use serde_json::{Value, json};

pub(super) use bench::{Benched, ScenarioBenched};
pub(super) use campaign::{CampaignEnded, MutantJudged};
pub(super) use case::{CaseChecked, CaseMade, CaseTry, CasesChecked};
pub(super) use described::{
    ClaimTold, Conformed, DifferenceTold, Exchanged, Learned, NodeChecked, NodePart, RepliedWith,
    Talked, ValueTold,
};
pub(super) use experiment::{
    BandJudged, ExperimentDone, ExperimentFigure, Experiments, RowJudged, RowsJudged,
};
pub(super) use fidelity::{FigureCompared, Figures, GroupTold};

use super::{CliError, Verdict};
use crate::TOOL;
use crate::robots::checker::{Check, Status};
use crate::show::folder::Metrics;

/// Version of the output.
const FORMAT: u32 = 1;

/// The status of a finished command.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum End {
    /// All expectations hold.
    Pass,
    /// An expectation failed.
    Fail,
    /// An expectation failed, but the rig was too late to know the cause.
    NotJudged,
    /// A signal ended the command.
    Interrupted,
    /// The command could not do its work; `error` holds the reason.
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

/// Schema for commands that write files, or print their content.
fn files_or_text(generator: &mut SchemaGenerator) -> Schema {
    let forms = [of::<Files>(generator), of::<Text>(generator)];
    json_schema!({ "anyOf": forms })
}

/// Schema for the command that makes and runs cases.
fn made_or_checked(generator: &mut SchemaGenerator) -> Schema {
    let forms = [
        of::<CaseMade>(generator),
        of::<CaseChecked>(generator),
        of::<CasesChecked>(generator),
    ];
    json_schema!({ "anyOf": forms })
}

/// Schema for the command that repeats experiments and judges the reports' rows.
fn done_or_judged(generator: &mut SchemaGenerator) -> Schema {
    let forms = [of::<Experiments>(generator), of::<RowsJudged>(generator)];
    json_schema!({ "anyOf": forms })
}

/// Schema for a command line without a known command, which has no result.
fn nothing(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": "null" })
}

/// The results of the commands.
const RESULTS: [(&str, Subschema); 35] = [
    ("", nothing),
    ("demo", of::<Runs>),
    ("run", of::<Runs>),
    ("debug", of::<Runs>),
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
    ("node", of::<NodeChecked>),
    ("bugs", of::<Bugs>),
    ("bench", of::<Benched>),
    ("campaign", of::<CampaignEnded>),
    ("fuzz", of::<FuzzEnded>),
    ("shrink", of::<Shrunk>),
    ("fidelity", of::<Figures>),
    ("experiment", done_or_judged),
    ("slam", of::<Surveyed>),
    ("map", of::<MapDifference>),
    ("schema", of::<Text>),
    ("wireshark", files_or_text),
    ("completions", of::<Text>),
    ("man", files_or_text),
    ("new", of::<Files>),
];

/// The JSON Schema of the output of `--json`.
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
        "title": "Output of a command of hilrig with --json",
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

/// Text that is the whole result.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Text {
    pub(super) text: String,
}

/// Files that were written.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Files {
    pub(super) files: Vec<String>,
}

/// Judged runs and cases.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(super) struct Runs {
    pub(super) runs: Vec<RunEnded>,
}

/// A judged run or case.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct RunEnded {
    /// Name of the scenario or case.
    pub(super) name: String,
    /// Seed of the run; none for a case of bytes.
    pub(super) seed: Option<u64>,
    pub(super) verdict: Status,
    pub(super) checks: Vec<Check>,
    /// The probable cause, if the foreign program failed.
    pub(super) probable_cause: Option<String>,
    /// Figures of the run; none for a case of bytes.
    pub(super) metrics: Option<Metrics>,
    /// Fingerprint of all bytes.
    pub(super) trace_hash: Option<String>,
    /// The result folder.
    pub(super) folder: Option<String>,
    /// The command that repeats the run, if it did not pass.
    pub(super) repeat: Option<String>,
}

/// A run in real time, judged only with `--out`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct UpEnded {
    /// Rig time.
    pub(super) ran_s: f64,
    /// Ports that were used.
    pub(super) used: Vec<String>,
    /// Faults and orders added by hand.
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
    /// The exit code, as a shell shows it: 128 plus the signal number for a signal.
    pub(super) program_exit_code: u8,
}

/// Faults of a running rig.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Faults {
    /// Number of the fault that was added or ended.
    pub(super) id: Option<u64>,
    /// All faults, with `list`: `id`, `state`, `fault`.
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

/// A line between two ports, with its faults.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct LinkEnded {
    /// The capture, if there is one.
    pub(super) file: Option<String>,
    pub(super) seed: u64,
    pub(super) ran_s: f64,
    pub(super) lines: Vec<LinePassed>,
}

/// One direction of the line.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct LinePassed {
    pub(super) from: String,
    pub(super) to: String,
    pub(super) bytes_sent: u64,
    /// Bytes at the output of the line.
    pub(super) bytes_arrived: u64,
    pub(super) bytes_lost: u64,
    pub(super) bytes_added: u64,
    /// Characters without a valid stop bit.
    pub(super) framing_errors: u64,
    /// Bytes that arrived while the port was closed.
    pub(super) bytes_unheard: u64,
    /// Bytes lost because the port's buffer was full.
    pub(super) bytes_overrun: u64,
}

/// A recording between ports.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct RecordEnded {
    pub(super) file: String,
    pub(super) ran_s: f64,
    pub(super) links: Vec<LinkRecorded>,
}

/// A recorded link.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct LinkRecorded {
    pub(super) name: String,
    pub(super) bytes_to_master: u64,
    pub(super) bytes_to_device: u64,
    /// Bytes that arrived while the receiving port was closed.
    pub(super) bytes_lost: u64,
}

/// A capture that was played.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(super) struct ReplayEnded {
    pub(super) played_s: f64,
    /// Bytes played to the program.
    pub(super) bytes_sent: u64,
    /// Bytes received from the program.
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
    /// Notes about the dump.
    pub(super) notes: Vec<String>,
}

/// A capture in another form.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Exported {
    pub(super) file: String,
    /// Counts of the exported content.
    pub(super) holds: String,
}

/// The content of a capture.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(super) struct Decoded {
    /// Frames and events of all lines, ordered by time; empty with `--summary` and `--diagnose`.
    pub(super) entries: Vec<EntryDecoded>,
    /// Figures of each line.
    pub(super) lines: Vec<LineDecoded>,
}

/// A frame, text, bad bytes or an event.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct EntryDecoded {
    /// Time since the start of the capture; none for a dump.
    pub(super) at_s: Option<f64>,
    pub(super) link: String,
    /// `to-master` or `to-device`.
    pub(super) direction: String,
    /// Offset of the first byte on its line.
    pub(super) place: u64,
    /// The meaning in words.
    pub(super) said: String,
}

/// One direction of a link.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct LineDecoded {
    /// Link and direction, if known.
    pub(super) name: String,
    pub(super) bytes: u64,
    /// The protocol with the most valid frames.
    pub(super) protocol: Option<String>,
    /// Bytes in valid frames.
    pub(super) framed: u64,
    /// Figures of the device, in words.
    pub(super) figures: Option<String>,
    /// Damage of the whole stream, with `--diagnose`.
    pub(super) damages: Vec<String>,
}

/// Defects of the fielded programs.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Bugs {
    /// Each with `id`, `place`, `sees`; a reproduced one with `defective`, `sound` and `holds`.
    pub(super) bugs: Vec<Value>,
}

/// The findings of a fuzzer.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(super) struct FuzzEnded {
    pub(super) folder: String,
    /// Causes, earlier runs in the same folder included.
    pub(super) findings: u64,
    /// Results of each target; none with a foreign program.
    pub(super) targets: Vec<TargetFuzzed>,
}

/// A fuzz target.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct TargetFuzzed {
    pub(super) name: String,
    pub(super) cases: u64,
    pub(super) behaviours: u64,
    pub(super) findings: u64,
}

/// A minimised case.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Shrunk {
    pub(super) file: String,
    pub(super) cause: String,
    /// The remaining content in words.
    pub(super) left: String,
    pub(super) tries: u64,
    /// The command that reproduces the failure.
    pub(super) repeat: String,
}

/// A log that was mapped.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Surveyed {
    pub(super) folder: String,
    pub(super) scans: u64,
    pub(super) skipped: u64,
    pub(super) doubtful: u64,
    pub(super) ambiguous: u64,
    /// Scans whose matched pose is far from the odometry pose.
    pub(super) jumps: u64,
    /// Loop closures.
    pub(super) loop_edges: u64,
    /// Parts of the map that were not joined to each other, 1 if all is one; null if no loops are
    /// closed.
    pub(super) parts: Option<u64>,
    /// Part of the path whose positions only the matching of scans determines, 0 to 1; 1 if the map
    /// has several parts; null if no loops are closed, or the log has no odometry.
    pub(super) doubt: Option<f64>,
    pub(super) cell_mm: f64,
    pub(super) scan_median_us: f64,
    pub(super) scan_longest_us: f64,
}

/// The differences of two maps.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct MapDifference {
    pub(super) shift_mm: [f64; 2],
    pub(super) turn_deg: f64,
    /// Mean distance.
    pub(super) wall_error_mm: f64,
    /// 95th percentile of the distance.
    pub(super) wall_error_95_mm: f64,
    /// Share of A's walls that B contains.
    pub(super) first_in_second: f64,
    /// Share of B's walls that A contains.
    pub(super) second_in_first: f64,
    /// Share of equal cells among those known in both maps.
    pub(super) alike: f64,
}
