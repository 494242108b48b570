//! Fault profiles: kinds and times of faults in generated missions, and expectations. A profile is
//! a TOML file; three are built in.

use std::path::Path;

use engine::scenario::{Document, FaultKind, SafetySpec, ScenarioError, Source, Span, read_whole};
use serde::Deserialize;

use super::fault_names;

/// The built-in profiles, gentlest first.
const BUILT_IN: [(&str, &str); 3] = [
    ("gentle", include_str!("profiles/gentle.toml")),
    ("field", include_str!("profiles/field.toml")),
    ("harsh", include_str!("profiles/harsh.toml")),
];

/// Version of the format.
const SCHEMA: u32 = 1;
/// Maximum number of faults: with more, all runs become alike.
const COUNT_MAX: u64 = 100;
/// Maximum length of a run: one day.
const LONGEST: Span = Span::from_millis(86_400_000);

/// A fault profile.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Version of the format: 1.
    pub schema: u32,
    /// Its name, for reports.
    pub name: String,
    /// The purpose of the profile in one sentence.
    #[serde(default)]
    pub description: String,
    /// The kinds of faults.
    pub faults: Faults,
    /// The times of faults.
    pub time: Time,
    /// Further actions of the operator.
    #[serde(default)]
    pub mission: MissionKeys,
    /// Actions after the last fault.
    #[serde(default)]
    pub afterwards: Afterwards,
    /// Expectations.
    pub judge: Judge,
    /// The reference to the profile in a campaign: the name of a built-in profile, or the text of a
    /// file.
    #[serde(skip)]
    pub kept: String,
}

/// The kinds of faults.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Faults {
    /// Share of the runs that have no fault, per cent.
    #[serde(default)]
    pub without_percent: u64,
    /// Maximum number of faults in a run.
    pub count_max: u64,
    /// Probabilities per byte; each fault with a rate uses one of them.
    pub rates: Vec<f64>,
    /// Wrong factors of measurements.
    pub factors: Vec<f64>,
    /// Kinds of faults, and device faults, that are excluded.
    #[serde(default)]
    pub never: Vec<String>,
    /// Whether the battery may be low in a search that ends at home.
    #[serde(default)]
    pub low_battery_in_search: bool,
    /// Share of the runs in which the link of the orders is noisy for some time, per cent.
    #[serde(default)]
    pub noisy_orders_percent: u64,
    /// Share of the runs in which one direction of any link has up to three kinds of noise, each
    /// for some time, per cent.
    #[serde(default)]
    pub noisy_link_percent: u64,
    /// Whether half of the inserted bytes are the first byte of a frame, or 0.
    #[serde(default)]
    pub stray_starts: bool,
    /// Share of permanent faults, which last until they are healed, per cent.
    #[serde(default)]
    pub permanent_percent: u64,
    /// Share of the runs in which a link that the robot needs becomes silent until it is healed,
    /// per cent.
    #[serde(default)]
    pub needed_link_percent: u64,
    /// Share of the runs in which one permanent fault is not healed, per cent.
    #[serde(default)]
    pub stays_broken_percent: u64,
}

/// The times of faults.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Time {
    /// Earliest start of a fault.
    pub from: Span,
    /// End of all faults; if not given, the start of the last phase.
    #[serde(default)]
    pub until: Option<Span>,
    /// Maximum length of a run with faults.
    #[serde(default)]
    pub length_max: Option<Span>,
    /// Length of the last phase, in which faults are healed.
    #[serde(default)]
    pub heal: Option<Span>,
    /// Maximum silence of a link or a device; no limit if not given.
    #[serde(default)]
    pub silence_max: Option<Span>,
    /// Maximum time for which a moving part seems to stand still; no limit if not given.
    #[serde(default)]
    pub stuck_max: Option<Span>,
    /// Maximum duration of a fault that waits for a trigger.
    #[serde(default)]
    pub triggered_max: Option<Span>,
    /// Maximum duration of any other fault; no limit if not given.
    #[serde(default)]
    pub other_max: Option<Span>,
    /// Whether some faults wait for a byte, a frame, a position or a register.
    #[serde(default)]
    pub triggered: bool,
    /// Whether some runs have phases.
    #[serde(default)]
    pub phases: bool,
}

/// Further actions of the operator in a run with faults.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MissionKeys {
    /// Interval at which the waypoints are ordered again.
    #[serde(default)]
    pub repeat: Option<Span>,
    /// Share of the runs in which the operator turns the robot by hand, per cent.
    #[serde(default)]
    pub by_hand_percent: u64,
    /// Share of the runs with faults in which the operator gives unusual orders: an empty list, a
    /// long or a short one, any mode, a stop; per cent.
    #[serde(default)]
    pub odd_orders_percent: u64,
    /// Share of the runs with faults in which valid frames with arbitrary contents arrive on the
    /// link of the orders, per cent.
    #[serde(default)]
    pub forged_percent: u64,
    /// Share of the runs with faults in which the operator uses everything that the station offers:
    /// drives by hand, many orders at once, other poses, leaving without a word; per cent.
    #[serde(default)]
    pub operator_percent: u64,
    /// Share of the runs in which such an operator is the only disturbance, per cent.
    #[serde(default)]
    pub operator_alone_percent: u64,
    /// Share of the runs without a fault in which the operator orders another list first, per cent.
    #[serde(default)]
    pub changes_percent: u64,
    /// Time for which the operator orders other lists before the mission in long runs without a
    /// fault, and the share of these runs, per cent.
    #[serde(default)]
    pub long: Option<Span>,
    /// See `long`.
    #[serde(default)]
    pub long_percent: u64,
}

/// Actions after the last fault.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Afterwards {
    /// Whether an operator opens the port and orders the mission again.
    #[serde(default)]
    pub operator: bool,
    /// Whether a device is power-cycled if a fault may have opened its console.
    #[serde(default)]
    pub power_cycle: bool,
    /// Time to finish the mission.
    #[serde(default)]
    pub recovery: Option<Span>,
}

/// Expectations.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Judge {
    /// The runs in which the mission must be finished.
    pub mission: MissionJudged,
    /// In runs without faults: minimum agreement of map and world, if the scenario expects one and
    /// its world is generated.
    #[serde(default)]
    pub walls_min: Option<f64>,
    /// Safety during the whole run.
    #[serde(default)]
    pub safety: Option<SafetySpec>,
}

/// The runs in which the mission must be finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MissionJudged {
    /// In runs with faults after the faults, within wider limits.
    AfterFaults,
    /// Only in runs without faults, within the scenario's own limits.
    WithoutFaults,
}

impl Default for Profile {
    /// The gentle profile.
    fn default() -> Self {
        Self::built_in("gentle").expect("it is built in")
    }
}

impl Profile {
    /// Names of the built-in profiles.
    pub fn names() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|(name, _)| *name)
    }

    /// The text of the built-in profile `name`, as a template.
    pub fn text(name: &str) -> Option<&'static str> {
        let found = BUILT_IN.iter().find(|(known, _)| *known == name);
        found.map(|(_, text)| *text)
    }

    fn built_in(name: &str) -> Option<Self> {
        let path = format!("<profile {name}>");
        let profile = Self::parse(Path::new(&path), Self::text(name)?.to_owned());
        let profile = profile.expect("a test reads each of them");
        Some(Self {
            kept: name.to_owned(),
            ..profile
        })
    }

    /// The built-in profile `name`, or the profile in the file `name`.
    ///
    /// # Errors
    /// If neither exists, or the file is not a profile.
    pub fn find(name: &str) -> Result<Self, ScenarioError> {
        if let Some(profile) = Self::built_in(name) {
            return Ok(profile);
        }
        let path = Path::new(name);
        match std::fs::read_to_string(path) {
            Ok(text) => Self::parse(path, text),
            Err(source) => {
                let names: Vec<&str> = Self::names().collect();
                Err(ScenarioError::Invalid {
                    path: path.to_owned(),
                    line: None,
                    key: "--profile".to_owned(),
                    message: format!(
                        "cannot be read ({source}), expected {} or a file",
                        names.join(", ")
                    ),
                })
            }
        }
    }

    /// Parses a profile; `path` is used in error messages.
    ///
    /// # Errors
    /// If the text is not a profile; the error names file, line and key.
    pub fn parse(path: &Path, text: String) -> Result<Self, ScenarioError> {
        let path = path.to_owned();
        let source = Source { path, text };
        let read =
            |document: Document<'_>| Self::deserialize(toml::de::Deserializer::from(document));
        let profile = read_whole(&source, read)?;
        profile.check(&source)?;
        Ok(Self {
            kept: source.text,
            ..profile
        })
    }

    /// Whether the profile is the gentle one, which early campaigns always used.
    pub fn is_gentle(&self) -> bool {
        self.kept == "gentle"
    }

    fn check(&self, source: &Source) -> Result<(), ScenarioError> {
        let wrong = |table: &str, key: &str, message: String| {
            let key_of = if table.is_empty() {
                key.to_owned()
            } else {
                format!("{table}.{key}")
            };
            Err(source.invalid(line_of(source, table, key), key_of, message))
        };
        if self.schema != SCHEMA {
            return wrong(
                "",
                "schema",
                format!("is {}, expected {SCHEMA}", self.schema),
            );
        }
        let faults = &self.faults;
        for (table, key, percent) in [
            ("faults", "without_percent", faults.without_percent),
            ("faults", "permanent_percent", faults.permanent_percent),
            (
                "faults",
                "stays_broken_percent",
                faults.stays_broken_percent,
            ),
            ("faults", "needed_link_percent", faults.needed_link_percent),
            (
                "faults",
                "noisy_orders_percent",
                faults.noisy_orders_percent,
            ),
            ("faults", "noisy_link_percent", faults.noisy_link_percent),
            ("mission", "by_hand_percent", self.mission.by_hand_percent),
            (
                "mission",
                "odd_orders_percent",
                self.mission.odd_orders_percent,
            ),
            ("mission", "forged_percent", self.mission.forged_percent),
            ("mission", "operator_percent", self.mission.operator_percent),
            (
                "mission",
                "operator_alone_percent",
                self.mission.operator_alone_percent,
            ),
            ("mission", "changes_percent", self.mission.changes_percent),
            ("mission", "long_percent", self.mission.long_percent),
        ] {
            if percent > 100 {
                return wrong(table, key, format!("is {percent}, expected 0 to 100"));
            }
        }
        if faults.count_max > COUNT_MAX {
            let message = format!("is {}, expected 0 to {COUNT_MAX}", faults.count_max);
            return wrong("faults", "count_max", message);
        }
        let kinds = FaultKind::ALL.iter().map(|kind| kind.name());
        let known: Vec<&str> = kinds.chain(fault_names::of_devices()).collect();
        for name in &faults.never {
            if let Some(meant) = engine::near::misspelt(name, &known) {
                let message = format!("there is no fault \"{name}\", did you mean \"{meant}\"?");
                return wrong("faults", "never", message);
            }
        }
        if faults.rates.is_empty() || faults.rates.iter().any(|rate| !(0.0..=1.0).contains(rate)) {
            return wrong(
                "faults",
                "rates",
                "expected at least one probability from 0 to 1".to_owned(),
            );
        }
        let is_far = |factor: &f64| !(-1e6..=1e6).contains(factor);
        if faults.factors.is_empty() || faults.factors.iter().any(is_far) {
            let message = "expected at least one factor from -1000000 to 1000000";
            return wrong("faults", "factors", message.to_owned());
        }
        self.check_times(&wrong)
    }

    fn check_times(
        &self,
        wrong: &dyn Fn(&str, &str, String) -> Result<(), ScenarioError>,
    ) -> Result<(), ScenarioError> {
        let time = &self.time;
        let (from, least) = (time.from, Span::from_millis(LEAST_MS));
        if time.until.is_some() == time.heal.is_some() {
            let message = "expected until (with afterwards) or heal: exactly one of them";
            return wrong("time", "until", message.to_owned());
        }
        let ends = time.until.map(|until| ("until", until.0));
        let length = time.length_max.map_or(LONGEST, |length| length);
        let heals = time
            .heal
            .map(|heal| ("heal", length.0.saturating_sub(heal.0)));
        for (key, end) in ends.into_iter().chain(heals) {
            if end < from.0 + least.0 {
                let message = format!("leaves less than {least} for faults after from = {from}");
                return wrong("time", key, message);
            }
        }
        if time.phases && time.until.is_none_or(|until| until.0 < PHASES_MIN.0) {
            let message = format!("expected false, or time.until of at least {PHASES_MIN}");
            return wrong("time", "phases", message);
        }
        for (key, most) in [
            ("silence_max", time.silence_max),
            ("stuck_max", time.stuck_max),
            ("triggered_max", time.triggered_max),
            ("other_max", time.other_max),
        ] {
            if most.is_some_and(|most| most < Span::from_millis(10) || most > LONGEST) {
                let message = format!("expected a time from 10ms to {LONGEST}");
                return wrong("time", key, message);
            }
        }
        let must_heal = self.judge.mission == MissionJudged::AfterFaults;
        if must_heal && self.faults.stays_broken_percent > 0 {
            let message = "expected 0 with judge.mission = \"after-faults\": a permanent fault can \
                           prevent the mission's end";
            return wrong("faults", "stays_broken_percent", message.to_owned());
        }
        if time.triggered && time.heal.is_some() {
            let message = "expected false with time.heal: a triggered fault can begin after it";
            return wrong("time", "triggered", message.to_owned());
        }
        if self
            .mission
            .repeat
            .is_some_and(|every| every < Span::from_millis(1_000))
        {
            return wrong("mission", "repeat", "expected at least 1s".to_owned());
        }
        let long = self.mission.long;
        if long.is_some_and(|long| long < Span::from_millis(60_000) || long > LONGEST) {
            let message = format!("expected a time from 60s to {LONGEST}");
            return wrong("mission", "long", message);
        }
        let alive = self
            .judge
            .safety
            .as_ref()
            .and_then(|safety| safety.alive_for);
        if alive.is_some_and(|alive| time.heal.is_none_or(|heal| alive >= heal)) {
            let message = "expected less than time.heal: the robot needs time to recover";
            return wrong("judge.safety", "alive_for", message.to_owned());
        }
        Ok(())
    }
}

/// Minimum time for faults, milliseconds: the operator's steps lie within it.
const LEAST_MS: u64 = 5_000;
/// A warm-up of 5 s, and the same time for the faults.
const PHASES_MIN: Span = Span::from_millis(10_000);

/// The line of `key` in `table`, for error messages.
fn line_of(source: &Source, table: &str, key: &str) -> Option<core::ops::Range<usize>> {
    let mut is_in = table.is_empty();
    let mut at = 0;
    for line in source.text.split_inclusive('\n') {
        let span = at..at + line.trim_end().len();
        at += line.len();
        let line = line.trim();
        if line.starts_with('[') {
            is_in = line.trim_matches(['[', ']']) == table;
        } else if is_in
            && line
                .strip_prefix(key)
                .is_some_and(|rest| rest.trim_start().starts_with('='))
        {
            return Some(span);
        }
    }
    source.find(if table.is_empty() { key } else { table })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each wrong value is rejected with file, line, key and the expected value. Line numbers are
    /// those of the built-in gentle profile.
    #[test]
    fn what_is_wrong_in_a_profile_is_named() {
        let refused = |from: &str, to: &str| {
            let text = Profile::text("gentle").expect("it is built in");
            assert!(text.contains(from), "{from}");
            let parsed = Profile::parse(Path::new("my.toml"), text.replace(from, to));
            parsed.expect_err("refused").to_string()
        };
        for (from, to, told) in [
            (
                "schema = 1",
                "schema = 2",
                "my.toml:2: schema: is 2, expected 1",
            ),
            (
                "count_max = 12",
                "count_max = 1000",
                "my.toml:7: faults.count_max: is 1000",
            ),
            (
                "count_max",
                "counts_max",
                "faults.counts_max: is an unknown key, did you mean \"count_max\"?",
            ),
            (
                "\"mirrored\"",
                "\"mirored\"",
                "faults.never: there is no fault \"mirored\", did you mean \"mirrored\"?",
            ),
            (
                "count_max = 12",
                "count_max = 12\nstays_broken_percent = 5",
                "my.toml:8: faults.stays_broken_percent: expected 0 with",
            ),
            (
                "0.03]",
                "1.5]",
                "my.toml:9: faults.rates: expected at least one probability from 0 to 1",
            ),
            (
                "until = \"14s\"",
                "until = \"1s\"",
                "time.until: leaves less than 5s",
            ),
            (
                "until = \"14s\"",
                "heal = \"14s\"",
                "time.phases: expected false",
            ),
            (
                "until = \"14s\"",
                "",
                "expected until (with afterwards) or heal",
            ),
            (
                "\"after-faults\"",
                "\"never\"",
                ": is \"never\", expected one of ",
            ),
            ("\"3s\"", "\"3\"", "silence_max: \"3\" is no time"),
        ] {
            let error = refused(from, to);
            assert!(error.contains(told), "{error}");
            assert!(error.starts_with("my.toml"), "{error}");
        }
        let error = Profile::find("hash")
            .expect_err("no such profile")
            .to_string();
        assert!(
            error.contains("expected gentle, field, harsh or a file"),
            "{error}"
        );
    }

    #[test]
    fn the_built_in_profiles_are_sound_and_have_their_names() {
        for name in Profile::names() {
            let profile = Profile::find(name).expect("it is built in");
            assert_eq!(
                (&*profile.name, profile.is_gentle()),
                (name, name == "gentle")
            );
            assert!(!profile.description.is_empty());
        }
    }
}
