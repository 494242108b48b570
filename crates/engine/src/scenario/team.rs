//! Further robots in the world of a scenario.
//!
//! A member is the scenario that it would be if its robot were alone: the world of the file, and
//! the tables of the member in the place of those of the file. So a member needs no rules of its
//! own.

use std::collections::BTreeMap;
use std::path::Path;

use emulators::rng::Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;
use toml::de::DeValue;

use super::world::{BodySpec, StartSpec};
use super::{
    ChassisSpec, DeviceSpec, Document, ExecSpec, Expect, FaultSpec, LinkSpec, Mission, NO_ROBOT,
    ProgramSpec, Scenario, ScenarioError, Source, device,
};

/// Maximum number of further robots.
const MEMBERS_MAX: usize = 7;

/// A further robot in the same world, with a program of its own. Its tables have the keys of the
/// tables of the same names; links and devices in them are those of this robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MemberSpec {
    /// Name of the robot, as the key `robot` of the file.
    pub robot: String,
    /// Start pose of the robot, as `world.start`; the robot's program knows this pose.
    #[schemars(with = "StartSpec")]
    pub start: Spanned<StartSpec>,
    /// Body of the robot, as `[world.body]`.
    #[serde(default)]
    #[schemars(schema_with = "table")]
    pub body: BodySpec,
    /// Task of the robot, as `[mission]`.
    #[serde(default)]
    #[schemars(schema_with = "table")]
    pub mission: Mission,
    /// Conditions that must be true at the end, as `[expect]`.
    #[serde(default)]
    #[schemars(schema_with = "table")]
    pub expect: Expect,
    /// The robot's program, as `[program]`.
    #[serde(default)]
    #[schemars(schema_with = "table")]
    pub program: ProgramSpec,
    /// Drive train of a custom robot, as `[chassis]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(schema_with = "table")]
    pub chassis: Option<ChassisSpec>,
    /// Settings of the robot's devices, as `[device.NAME]`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(schema_with = "table")]
    pub device: BTreeMap<String, DeviceSpec>,
    /// Programs of your own for the robot, as `[exec.NAME]`. The variables of their ports have the
    /// names of a robot alone.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(schema_with = "table")]
    pub exec: BTreeMap<String, ExecSpec>,
    /// Settings of the robot's links, as `[link.NAME]`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(schema_with = "table")]
    pub link: BTreeMap<String, LinkSpec>,
    /// Faults of the robot's links and devices, as `[[fault]]`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(schema_with = "tables")]
    pub fault: Vec<FaultSpec>,
}

/// A table with the keys of another table of the file.
fn table(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
    schemars::json_schema!({ "type": "object" })
}

fn tables(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
    schemars::json_schema!({ "type": "array", "items": { "type": "object" } })
}

/// Devices of each member, by the names of the members.
pub(super) type Devices = BTreeMap<String, BTreeMap<String, DeviceSpec>>;

/// Takes the devices of the members from a file. Each keeps its position in the file.
pub(super) fn read_devices(document: &mut Document<'_>) -> Result<Devices, toml::de::Error> {
    let team = document.get_mut().get_mut("team").map(Spanned::get_mut);
    let Some(DeValue::Table(team)) = team else {
        return Ok(BTreeMap::new());
    };
    let mut found = BTreeMap::new();
    for (name, member) in team.iter_mut() {
        if let DeValue::Table(member) = member.get_mut() {
            let devices = device::read_devices(member)?;
            found.insert(name.get_ref().clone().into_owned(), devices);
        }
    }
    Ok(found)
}

impl MemberSpec {
    /// The robot alone in the world of `scenario`, in which it is called `name`. Its random numbers
    /// differ from those of an equal robot.
    fn alone(&self, scenario: &Scenario, name: &str) -> Scenario {
        let seed = Rng::stream(scenario.seed, &format!("team.{name}")).next_u64() >> 1;
        Scenario {
            name: format!("{}-{name}", scenario.name),
            description: String::new(),
            robot: self.robot.clone(),
            seed,
            origin: None,
            computing: None,
            mission: self.mission.clone(),
            expect: self.expect.clone(),
            program: self.program.clone(),
            chassis: self.chassis.clone(),
            device: self.device.clone(),
            exec: self.exec.clone(),
            cable: BTreeMap::new(),
            link: self.link.clone(),
            world: scenario.world.with_robot(&self.start, self.body),
            fault: self.fault.clone(),
            team: BTreeMap::new(),
            ..*scenario
        }
    }
}

impl Scenario {
    /// The further robots, each as the scenario of a robot alone, with its part of `source`.
    pub fn members(&self, source: &Source) -> Vec<(String, Self, Source)> {
        let members = self.team.iter();
        let member = |(name, spec): (&String, &MemberSpec)| {
            let alone = spec.alone(self, name);
            (name.clone(), alone, source.of_member(name))
        };
        members.map(member).collect()
    }

    /// The programs of the file, each with the index of its robot, 0 for the first one. The name of
    /// a program of a further robot has the robot's name as prefix.
    pub fn programs(&self) -> impl Iterator<Item = (usize, String, &ExecSpec)> {
        let own = self.exec.iter();
        let own = own.map(|(name, spec)| (0, name.clone(), spec));
        let members = (1..).zip(&self.team);
        let others = members.flat_map(|(robot, (member, spec))| {
            let programs = spec.exec.iter();
            programs.map(move |(name, spec)| (robot, format!("{member}/{name}"), spec))
        });
        own.chain(others)
    }

    /// Checks number and names of the further robots.
    pub(super) fn check_team(&self, source: &Source, problems: &mut Vec<ScenarioError>) {
        if self.team.len() > MEMBERS_MAX {
            let message = format!(
                "has {} robots, expected at most {MEMBERS_MAX} beside the first",
                self.team.len()
            );
            problems.push(source.invalid(source.find("team"), "team", message));
        }
        if !self.team.is_empty() && self.robot == NO_ROBOT {
            let message = "expected none: without a robot there is no world for further ones";
            problems.push(source.invalid(source.find("team"), "team", message));
        }
        for (name, spec) in &self.team {
            let fits = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
            if name.is_empty() || !name.chars().all(fits) {
                let message = "expected a name of letters, digits, '-' and '_'";
                problems.push(source.invalid(source.find(name), format!("team.{name}"), message));
            }
            if spec.robot == NO_ROBOT {
                let message = "is \"none\", expected a robot: it needs a body";
                let source = source.of_member(name);
                let span = source.find("robot");
                problems.push(source.invalid(span, format!("team.{name}.robot"), message));
            }
        }
    }

    /// Makes relative paths in the settings of the members relative to `base`.
    pub(super) fn embed_team(&mut self, base: &Path) {
        for member in self.team.values_mut() {
            device::embed(&mut member.device, base);
            member.program.embed(base);
            member.exec.values_mut().for_each(|exec| exec.embed(base));
            let golden = member.expect.golden.iter_mut();
            golden.for_each(|golden| golden.embed(base));
        }
    }
}

impl Source {
    /// The part of the file about the robot `name` of its team, as if it were that of a robot
    /// alone: lines stay where they are, others are empty.
    fn of_member(&self, name: &str) -> Self {
        let heads = [format!("[team.{name}"), format!("[[team.{name}")];
        let mut text = String::with_capacity(self.text.len());
        let (mut is_kept, mut is_found) = (false, false);
        for line in self.text.split_inclusive('\n') {
            let content = line.trim_start();
            let own = heads.iter().find_map(|head| content.strip_prefix(&**head));
            let own = own.filter(|rest| rest.starts_with(['.', ']']));
            if content.starts_with('[') {
                is_kept = own.is_some() || content.starts_with("[world");
                is_found |= own.is_some();
            }
            let kept = match own {
                // The head of a table of the member becomes that of a table of the file.
                Some(rest) if rest.starts_with('.') => {
                    let open = if content.starts_with("[[") { "[[" } else { "[" };
                    format!("{open}{}", rest[1..].trim_end())
                }
                Some(_) => String::new(),
                None if is_kept => line.trim_end_matches('\n').to_owned(),
                None => String::new(),
            };
            let is_ended = line.ends_with('\n');
            let len = line.len() - usize::from(is_ended);
            text.push_str(&kept);
            text.extend(core::iter::repeat_n(' ', len - kept.len()));
            text.extend(is_ended.then_some('\n'));
        }
        Self {
            path: self.path.clone(),
            // Other forms of the table, such as inline ones, are searched as a whole.
            text: if is_found { text } else { self.text.clone() },
        }
    }
}

impl ScenarioError {
    /// The error of the robot `name` of a team, with the keys of the whole file.
    #[must_use]
    pub fn of_member(self, name: &str) -> Self {
        match self {
            Self::Several(all) => {
                Self::Several(all.into_iter().map(|one| one.of_member(name)).collect())
            }
            Self::Invalid {
                path,
                line,
                key,
                message,
            } => {
                let own = ["start", "body"].into_iter().find_map(|table| {
                    let rest = key.strip_prefix("world.")?.strip_prefix(table)?;
                    Some(format!("{table}{rest}"))
                });
                let key = match own {
                    Some(own) => format!("team.{name}.{own}"),
                    None if key.starts_with("world") => key,
                    None => format!("team.{name}.{key}"),
                };
                Self::Invalid {
                    path,
                    line,
                    key,
                    message,
                }
            }
            other => other,
        }
    }
}
