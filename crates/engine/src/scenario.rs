//! A run as data: world, robot, devices, faults, mission, expectations. One TOML file with a
//! closed schema: an unknown key is an error.

mod board;
mod cable;
mod chassis;
mod computing;
mod condition;
pub mod device;
mod drives;
mod fault;
mod golden;
mod limits;
mod maze;
mod mission;
mod own;
mod phases;
pub(crate) mod plan;
mod problems;
mod rule;
mod safety;
pub mod schema;
mod source;
mod team;
pub mod tuning;
mod unused;
pub mod world;

use core::num::NonZeroU32;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use board::{RaisesSpec, ResetSpec};
pub use cable::{CableSpec, ExecSpec};
pub(crate) use chassis::body_error;
pub use chassis::{AckermannSpec, ChassisSpec, DifferentialSpec, FloorSpec};
pub use computing::{CHARGE_UNIT, Charges, ComputingSpec};
pub use condition::{
    AxisCondition, BytesCondition, Condition, ContactCondition, EventCondition, Figure,
    FrameCondition, MapCondition, Op, Operand, PoseCondition, Quantity, RegisterCondition,
    RobotCondition,
};
pub use device::{
    AvrBaseSpec, DeviceSpec, Hc06Spec, MotorSpec, MountSpec, RplidarSpec, SupplySpec, TapSpec,
    TouchPanelSpec, TurnSpec, Xv11Spec,
};
pub use drives::DrivesSpec;
pub(crate) use fault::is_place_of;
pub use fault::{
    AdapterSpec, DirectionSpec, FaultKind, FaultPlace, FaultSpec, Flaw, LinkSpec, RegisterName,
    WhenSpec, catalogue as fault_catalogue,
};
pub use golden::{GoldenSpec, Walls};
pub use maze::MazeSpec;
pub use mission::{Action, Expect, InjectSpec, Mission, SetPoint, SetSpec, Step};
pub use own::{
    AccessSpec, CommandSpec, OrderSpec, PeriodicSpec, RegisterSpec, RegistersSpec, SourceSpec,
    TextSpec, VariableSpec, WidthSpec,
};
pub use phases::{BudgetSpec, PhasesSpec};
pub use problems::{Document, read_whole};
pub use rule::{Demand, LOOK_EVERY, RuleSpec, UntilSpec};
pub use safety::SafetySpec;
pub use source::{ScenarioError, Source, text_of};
pub use span::Span;
pub use team::MemberSpec;
pub use tuning::TuningSpec;
pub use world::WorldSpec;
pub use world::{PillarSpec, StartSpec, WallSpec};

/// The only schema version so far. Later versions will still read it.
pub const SCHEMA: u32 = 1;

/// The keys and tables at the top of the file. Others are errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Version of the format: 1.
    #[serde(deserialize_with = "known_schema")]
    pub schema: u32,
    /// Short name for files and reports: letters, digits, `-`, `_` and `.`.
    #[serde(deserialize_with = "file_name")]
    pub name: String,
    /// Human-readable description.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Name of the robot.
    pub robot: String,
    /// Maximum duration of the run; it ends earlier when the mission is done.
    pub duration: Span,
    /// Seed of all randomness, 0 to 9223372036854775807; `--seed` replaces it.
    #[serde(default = "default_seed", deserialize_with = "seed")]
    #[schemars(range(min = 0, max = 9_223_372_036_854_775_807_u64))]
    pub seed: u64,
    /// Origin of a saved case; written by the rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<Origin>,
    /// Measured computing of a program in virtual time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub computing: Option<ComputingSpec>,
    /// Task of the robot.
    #[serde(default)]
    pub mission: Mission,
    /// Conditions that must be true at the end.
    #[serde(default)]
    pub expect: Expect,
    /// The robot's program.
    #[serde(default)]
    pub program: ProgramSpec,
    /// Drive train of a custom robot; two wheels with the figures of `[world.body]` if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chassis: Option<ChassisSpec>,
    /// Settings of the robot's devices, by their names, and your own devices.
    #[serde(default)]
    #[schemars(schema_with = "schema::devices")]
    pub device: BTreeMap<String, DeviceSpec>,
    /// Programs of your own, by their names: `hilrig run FILE` starts them together.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub exec: BTreeMap<String, ExecSpec>,
    /// Serial cables between your programs, by their names.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub cable: BTreeMap<String, CableSpec>,
    /// Settings of links, by the names that the robot gives them.
    #[serde(default)]
    pub link: BTreeMap<String, LinkSpec>,
    /// Limits of random faults.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget: Option<BudgetSpec>,
    /// Phases of the run: times of random faults, and the time in which the robot must work again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phases: Option<PhasesSpec>,
    /// The true world; only `robot = "none"` may omit it.
    #[serde(
        default = "WorldSpec::nowhere",
        skip_serializing_if = "WorldSpec::is_nowhere"
    )]
    pub world: WorldSpec,
    /// A fault.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fault: Vec<FaultSpec>,
    /// Further robots in the same world, by their names.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub team: BTreeMap<String, MemberSpec>,
}

/// Origin of a saved case.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Tool and version that wrote the case.
    pub tool: String,
    /// Hash of all bytes of the original run.
    pub trace_hash: String,
}

/// Settings of the robot's program.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProgramSpec {
    /// Mode in which the program starts, by the robot's name for it; the stop mode if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_mode: Option<String>,
    /// Mapping algorithm.
    #[serde(default)]
    pub mapper: MapperSpec,
    /// Processor of the program.
    #[serde(default)]
    pub cpu: CpuSpec,
    /// Enabled defects of the fielded program, by their IDs in `hilrig bugs`; none if not given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<String>")]
    pub defects: Vec<toml::Spanned<String>>,
    /// Whether the program also reports battery, errors and findings to the PC, if it supports
    /// this.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub diagnosis: bool,
    /// UART rate of the radio at the robot's start, bit/s, e.g. 9600 for a new module. If the
    /// program supports this, it first sets name, PIN and its own rate by commands. This takes
    /// about five seconds, in which no PC may connect. If not given, the radio is already
    /// configured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radio_baud: Option<NonZeroU32>,
    /// Map that yellow's PC knows at the start: `map.yaml` of the result folder of another run, in
    /// the world's frame, with cells of 0.1 m. A relative path starts at the folder of the
    /// scenario's file. The PC then localises and navigates without mapping.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<PathBuf>,
    /// Rule by which yellow's PC combines the matches of all headings to one pose; `best` if not
    /// given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub votes: Option<VotesSpec>,
    /// Figures that replace the program's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<TuningSpec>")]
    pub tuning: Option<toml::Spanned<TuningSpec>>,
}

impl ProgramSpec {
    /// Stores the whole path of the map, so that a saved case finds the file.
    pub(crate) fn embed(&mut self, base: &Path) {
        if let Some(map) = &mut self.map {
            let whole = base.join(&*map);
            *map = std::path::absolute(&whole).unwrap_or(whole);
        }
    }

    /// Whether the table has settings for the program itself, and not only for its processor, which
    /// the rig models.
    pub fn has_settings(&self) -> bool {
        let default = Self {
            cpu: self.cpu,
            ..Self::default()
        };
        *self != default
    }
}

/// Mapping algorithms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MapperSpec {
    /// The best algorithm of the program.
    #[default]
    Best,
    /// The algorithm of the seed document.
    Document,
}

/// Rules of a localisation that tries all headings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum VotesSpec {
    /// The best match of all wins; if another pose fits nearly as well, the robot looks again.
    Best,
    /// Each heading votes for its best cell, votes are added: the report of the course.
    Added,
    /// As `added`, but votes multiply: the fielded program, like the defect `YP-11`.
    Multiplied,
}

/// Processors whose speed is modelled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CpuSpec {
    /// Cortex-M4 at 168 MHz, with the costs of the seed document.
    #[default]
    Stm32f4,
    /// A processor without computing time.
    Ideal,
}

/// The robot of a scenario that has devices only.
pub const NO_ROBOT: &str = "none";

const fn default_seed() -> u64 {
    1
}

fn known_schema<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    match u32::deserialize(deserializer)? {
        SCHEMA => Ok(SCHEMA),
        other => Err(serde::de::Error::custom(format!(
            "schema is {other}, expected {SCHEMA}"
        ))),
    }
}

fn seed<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
    let seed = i64::deserialize(deserializer)?;
    let expected = "expected a seed from 0 to 9223372036854775807";
    u64::try_from(seed).map_err(|_| serde::de::Error::custom(format!("seed is {seed}, {expected}")))
}

fn file_name<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    let name = String::deserialize(deserializer)?;
    let fits = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if name.is_empty() || name.starts_with('.') || !name.chars().all(fits) {
        let expected = "expected letters, digits, '-', '_' and '.'";
        return Err(serde::de::Error::custom(format!(
            "name is \"{name}\", {expected}"
        )));
    }
    Ok(name)
}

/// `text` without its table `name`.
fn without_table(text: &str, name: &str) -> String {
    let head = format!("[{name}]");
    let mut is_in = false;
    let lines = text.split_inclusive('\n').filter(|line| {
        if line.starts_with('[') {
            is_in = line.trim_end() == head;
        }
        !is_in
    });
    lines.collect()
}

impl Scenario {
    /// Reads a scenario file.
    pub fn read(path: &Path) -> Result<(Self, Source), ScenarioError> {
        Self::parse(path, text_of(path)?)
    }

    /// Reads a scenario from a string; its file paths are relative to the current directory.
    ///
    /// # Errors
    /// As [`parse`](Self::parse), with `<text>` instead of the file's name.
    pub fn from_text(text: &str) -> Result<(Self, Source), ScenarioError> {
        Self::parse(Path::new("<text>"), text.to_owned())
    }

    /// Reads a scenario from `text`; `path` is for messages and relative files.
    pub fn parse(path: &Path, text: String) -> Result<(Self, Source), ScenarioError> {
        let path = path.to_owned();
        let source = Source { path, text };
        limits::check_text(&source)?;
        let read = problems::read_mended(&source, Self::deserialized);
        let mut problems = read.problems;
        let Some(mut scenario) = read.value else {
            return Err(ScenarioError::all(problems));
        };
        if problems.is_empty() {
            problems = problems::too_long(&source, &scenario.to_toml());
        }
        let base = source.path.parent().unwrap_or_else(|| ".".as_ref());
        scenario.exec.values_mut().for_each(|exec| exec.embed(base));
        scenario
            .expect
            .golden
            .iter_mut()
            .for_each(|golden| golden.embed(base));
        device::embed(&mut scenario.device, base);
        scenario.program.embed(base);
        scenario.embed_team(base);
        limits::check(&scenario, &source, &mut problems);
        scenario.check_team(&source, &mut problems);
        for (name, member, part) in scenario.members(&source) {
            let mut found = Vec::new();
            limits::check(&member, &part, &mut found);
            problems.extend(found.into_iter().map(|error| error.of_member(&name)));
        }
        if problems.is_empty() {
            problems = problems::not_finite(&source);
        }
        if !problems.is_empty() {
            return Err(ScenarioError::all(problems));
        }
        if let Some(phases) = scenario.phases {
            if phases.length() > scenario.duration.0 {
                let message = "is shorter than the phases together, expected at least their sum";
                return Err(source.invalid(source.find("duration"), "duration", message));
            }
            let team = scenario.team.values_mut();
            let others = team.flat_map(|member| &mut member.fault);
            let faults = scenario.fault.iter_mut().chain(others);
            faults.for_each(|fault| phases.confine(fault));
        }
        Ok((scenario, source))
    }

    /// Devices are read separately, because their settings have their own types and must keep their
    /// positions in the file.
    fn deserialized(mut document: Document<'_>) -> Result<Self, toml::de::Error> {
        let device = device::read_devices(document.get_mut());
        let team = team::read_devices(&mut document);
        let mut scenario = Self::deserialize(toml::de::Deserializer::from(document))?;
        scenario.device = device?;
        for (name, devices) in team? {
            if let Some(member) = scenario.team.get_mut(&name) {
                member.device = devices;
            }
        }
        Ok(scenario)
    }

    /// The scenario as a file.
    pub fn to_toml(&self) -> String {
        // Compiles the serialization of each type once, and not once for each serializer of toml.
        let erased: &dyn erased_serde::Serialize = self;
        let text = toml::to_string(erased).expect("every field has a TOML form");
        // Without a robot there is no program that could have settings.
        match self.robot == NO_ROBOT && self.program == ProgramSpec::default() {
            true => without_table(&text, "program"),
            false => text,
        }
    }
}
