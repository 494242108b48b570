//! Rules of the user's own robot: `[[expect.rule]]`.

use core::fmt;
use core::time::Duration;
use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{Condition, Flaw, Span};

/// Period at which the state is sampled: registers, axes, figures of the robot.
pub const LOOK_EVERY: Duration = Duration::from_millis(10);

/// A rule of the robot that the run checks from its start to its end: give `always`, `never`,
/// `eventually` or `sometimes`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RuleSpec {
    /// Name of the rule: letters, digits, `-`, `_` and `.`. The check is called `rule-NAME`, a
    /// goal's `goal-NAME`.
    pub name: String,
    /// Condition that must hold at each moment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub always: Option<Condition>,
    /// Condition that must not hold at any moment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub never: Option<Condition>,
    /// Condition that must hold at least once; with `after`, at least once each time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eventually: Option<Condition>,
    /// Condition of a goal: a run may miss it, but a campaign must reach it in at least one run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sometimes: Option<Condition>,
    /// The rule applies each time this condition becomes true.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after: Option<Condition>,
    /// With `after`: time to comply. `eventually` must hold within this time, `always` and `never`
    /// from this time on. Without `after`, `eventually` must hold within this time from `from` on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within: Option<Span>,
    /// With `after` and `eventually`: whether each trigger needs an answer of its own. By default
    /// one answer counts for all triggers that wait.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub each: bool,
    /// With `after`, and `always` or `never`: how long it applies, counted after `within`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lasting: Option<Span>,
    /// The rule applies from this time on; from the start of the run if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<Span>,
    /// The rule applies until this time, or until this condition holds. With `after`, the rule
    /// applies again the next time; otherwise it ends for the rest of the run. Until the end of the
    /// run if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<UntilSpec>,
    /// Whether a single run passes without observing the rule; a campaign must observe it in at
    /// least one run.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub may_be_unobserved: bool,
}

/// A time, or a condition that ends something.
#[derive(Clone, Debug, PartialEq)]
pub enum UntilSpec {
    /// Time from the start of the run.
    At(Span),
    /// The moment at which a condition holds.
    When(Box<Condition>),
}

impl UntilSpec {
    /// The time, if the value is one.
    pub const fn time(&self) -> Option<Span> {
        match self {
            Self::At(at) => Some(*at),
            Self::When(_) => None,
        }
    }

    /// The condition, if the value is one.
    pub fn condition(&self) -> Option<&Condition> {
        match self {
            Self::At(_) => None,
            Self::When(condition) => Some(condition),
        }
    }
}

impl Serialize for UntilSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::At(at) => at.serialize(serializer),
            Self::When(condition) => condition.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for UntilSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = UntilSpec;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a time such as \"5s\", or a table with a condition")
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<UntilSpec, E> {
                text.parse().map(UntilSpec::At).map_err(E::custom)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<UntilSpec, A::Error> {
                // A condition is a table with one key, which serde treats as an enumeration.
                let condition = Condition::deserialize(MapAccessDeserializer::new(map))?;
                Ok(UntilSpec::When(Box::new(condition)))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

impl JsonSchema for UntilSpec {
    fn schema_name() -> Cow<'static, str> {
        "UntilSpec".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let time = generator.subschema_for::<Span>();
        let condition = generator.subschema_for::<Condition>();
        json_schema!({ "anyOf": [time, condition] })
    }
}

/// The demand of a rule on its condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Demand {
    /// It holds at each moment.
    Always,
    /// It holds at no moment.
    Never,
    /// It holds at one moment at least.
    Eventually,
    /// The same in one run of a campaign.
    Sometimes,
}

impl Demand {
    /// The key in a file.
    pub const fn key(self) -> &'static str {
        match self {
            Self::Always => "always",
            Self::Never => "never",
            Self::Eventually => "eventually",
            Self::Sometimes => "sometimes",
        }
    }
}

impl RuleSpec {
    /// The demand and its condition: the first that is given.
    pub fn demand(&self) -> Option<(Demand, &Condition)> {
        self.demands().next()
    }

    fn demands(&self) -> impl Iterator<Item = (Demand, &Condition)> {
        let all = [
            (Demand::Always, &self.always),
            (Demand::Never, &self.never),
            (Demand::Eventually, &self.eventually),
            (Demand::Sometimes, &self.sometimes),
        ];
        all.into_iter()
            .filter_map(|(demand, condition)| Some((demand, condition.as_ref()?)))
    }

    /// Each condition with its key.
    pub fn conditions(&self) -> impl Iterator<Item = (&'static str, &Condition)> {
        let until = self.until.as_ref().and_then(UntilSpec::condition);
        let others = [("after", self.after.as_ref()), ("until", until)];
        let others = others
            .into_iter()
            .filter_map(|(key, condition)| Some((key, condition?)));
        let demands = self.demands();
        demands
            .map(|(demand, condition)| (demand.key(), condition))
            .chain(others)
    }

    /// Name of its check.
    pub fn check_name(&self) -> String {
        match self.sometimes {
            Some(_) => format!("goal-{}", self.name),
            None => format!("rule-{}", self.name),
        }
    }

    /// Whether a single run must observe it.
    pub const fn must_be_observed(&self) -> bool {
        self.sometimes.is_none() && !self.may_be_unobserved
    }

    /// Whether only the end of a run shows that the rule was not met. A run that is too short
    /// breaks such a rule.
    pub const fn is_of_the_end(&self) -> bool {
        self.eventually.is_some() && (self.after.is_none() || self.within.is_none())
    }

    /// Checks its keys, independent of the robot.
    ///
    /// # Errors
    /// A flaw that names the key.
    pub fn check(&self) -> Result<(), Flaw> {
        let fits = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if self.name.is_empty() || !self.name.chars().all(fits) {
            let expected = "expected letters, digits, '-', '_' and '.'";
            let message = format!("is \"{}\", {expected}", self.name);
            return Err(Flaw::new("name", message));
        }
        let mut demands = self.demands();
        let (Some((demand, condition)), None) = (demands.next(), demands.next()) else {
            let message = "expected one of always, never, eventually and sometimes";
            return Err(Flaw::new("always", message));
        };
        for (key, condition) in self.conditions() {
            condition.check().map_err(|flaw| {
                let message = format!("{}: {}", flaw.key, flaw.message);
                Flaw::new(key, message)
            })?;
        }
        if demand == Demand::Always && !condition.can_be_false() {
            let message = "is a condition on bytes, a frame, a contact or an event, which holds \
                           only for a moment; expected eventually or never, or a field of the frame";
            return Err(Flaw::new("always", message));
        }
        self.check_times(demand)
    }

    /// The keys of times that lie beyond the end of a run, each with its time from the start.
    pub(super) fn times_beyond(&self, end: Span) -> Vec<(&'static str, Span)> {
        let from = self.from.unwrap_or_default();
        if from >= end {
            return vec![("from", from)];
        }
        let sum = |a: Span, b: Option<Span>| Some(Span(a.0 + b?.0));
        let within = sum(from, self.within);
        let lasting = sum(within.unwrap_or(from), self.lasting);
        let until = self.until.as_ref().and_then(UntilSpec::time);
        let until = until.filter(|until| *until > end);
        let spans = [
            ("within", within.filter(|at| *at >= end)),
            ("lasting", lasting.filter(|at| *at >= end)),
            ("until", until),
        ];
        let spans = spans.into_iter();
        spans.filter_map(|(key, at)| Some((key, at?))).collect()
    }

    fn check_times(&self, demand: Demand) -> Result<(), Flaw> {
        let holds_throughout = matches!(demand, Demand::Always | Demand::Never);
        let has_after = self.after.is_some();
        let key = demand.key();
        if self.each && !(has_after && demand == Demand::Eventually) {
            return Err(Flaw::new("each", "expected only with after and eventually"));
        }
        if self.may_be_unobserved && demand == Demand::Sometimes {
            let message = "expected none: a single run may always miss a goal";
            return Err(Flaw::new("may_be_unobserved", message));
        }
        self.check_against_looks()?;
        match (self.within, self.lasting) {
            (_, Some(_)) if !has_after || !holds_throughout => {
                let message = "expected only with after, and always or never";
                Err(Flaw::new("lasting", message))
            }
            (Some(_), _) if !has_after && holds_throughout => {
                let message = format!("expected only with after; without it, {key} takes from");
                Err(Flaw::new("within", message))
            }
            (Some(_), _) if !has_after && self.until.is_some() => Err(Flaw::new(
                "within",
                "expected within or until, and not both",
            )),
            _ => {
                let until = self.until.as_ref().and_then(UntilSpec::time);
                let from = self.from.unwrap_or_default();
                match until {
                    Some(until) if until <= from => {
                        let message = format!("is {until}, expected more than from, {from}");
                        Err(Flaw::new("until", message))
                    }
                    _ => Ok(()),
                }
            }
        }
    }
}

impl RuleSpec {
    /// Checks that no time is shorter than the sampling period of the state.
    fn check_against_looks(&self) -> Result<(), Flaw> {
        let mut conditions = self.conditions();
        let is_sampled = conditions.any(|(_, condition)| condition.is_of_state());
        let times = [("within", self.within), ("lasting", self.lasting)];
        for (key, time) in times {
            if let Some(time) = time.filter(|time| is_sampled && time.0 < LOOK_EVERY) {
                let message = format!(
                    "is {time}, but the state is read each {} ms: expected at least that, or a rule \
                     on frames, bytes, events and contacts alone",
                    LOOK_EVERY.as_millis()
                );
                return Err(Flaw::new(key, message));
            }
        }
        Ok(())
    }
}

impl fmt::Display for RuleSpec {
    /// `after event bump, within 300ms eventually axis left, set-point == 0`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(after) = &self.after {
            write!(f, "after {after}, ")?;
        }
        if let Some(within) = self.within {
            write!(f, "within {within} ")?;
        }
        if let Some((demand, condition)) = self.demand() {
            write!(f, "{} {condition}", demand.key())?;
        }
        if self.each {
            write!(f, " each time")?;
        }
        if let Some(lasting) = self.lasting {
            write!(f, " for {lasting}")?;
        }
        if let Some(from) = self.from {
            write!(f, ", from {from}")?;
        }
        match &self.until {
            Some(UntilSpec::At(at)) => write!(f, ", until {at}"),
            Some(UntilSpec::When(condition)) => write!(f, ", until {condition}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<String, String> {
        let rule: RuleSpec = toml::from_str(text).map_err(|error| error.to_string())?;
        let again = toml::to_string(&rule).expect("has a form");
        assert_eq!(toml::from_str::<RuleSpec>(&again).as_ref(), Ok(&rule));
        rule.check().map_err(|flaw| flaw.to_string())?;
        Ok(rule.to_string())
    }

    /// Each demand and each time as a sentence; a rule stays the same after writing and reading.
    #[test]
    fn rules_are_read_written_and_put_in_words() {
        let rows = [
            (
                "always = { robot = { of = \"speed-m-s\", op = \"<=\", value = 0.5 } }\nfrom = \"2s\"",
                "always speed in m/s <= 0.5, from 2s",
            ),
            (
                "after = { event = { rule = \"bump\" } }\nwithin = \"300ms\"\n\
                 eventually = { axis = { name = \"left\", value = 0 } }",
                "after event bump, within 300ms eventually axis left, set-point == 0",
            ),
            (
                "after = { contact = {} }\nwithin = \"1s\"\nlasting = \"2s\"\n\
                 never = { not = { visited = 1 } }\nuntil = { visited = 2 }",
                "after contact, within 1s never not (visited waypoints >= 1) for 2s, until visited \
                 waypoints >= 2",
            ),
            (
                "after = { event = { rule = \"a\" } }\nwithin = \"5ms\"\neach = true\n\
                 eventually = { event = { rule = \"b\" } }",
                "after event a, within 5ms eventually event b each time",
            ),
            (
                "sometimes = { any = [{ contact = { faster_than_m_s = 0.1 } }, { all = [\
                 { visited = 1 }, { map = { known_min = 0.5 } }] }] }\nuntil = \"9s\"",
                "sometimes contact faster than 0.1 m/s or (visited waypoints >= 1 and known share of \
                 the map >= 0.5), until 9s",
            ),
        ];
        for (text, words) in rows {
            let text = format!("name = \"a\"\n{text}");
            assert_eq!(read(&text).as_deref(), Ok(words), "{text}");
        }
    }

    #[test]
    fn rules_that_make_no_sense_are_refused_with_the_key() {
        let visited = "{ visited = 1 }";
        let rows = [
            ("name = \"\"".to_owned(), "name: is \"\""),
            ("name = \"a b\"".to_owned(), "name: is \"a b\""),
            ("name = \"a\"".to_owned(), "always: expected one of always"),
            (
                format!("name = \"a\"\nalways = {visited}\nnever = {visited}"),
                "always: expected one of always",
            ),
            (
                "name = \"a\"\nalways = { event = { rule = \"x\" } }".to_owned(),
                "always: is a condition on bytes",
            ),
            (
                format!("name = \"a\"\nalways = {visited}\nwithin = \"1s\""),
                "within: expected only with after",
            ),
            (
                format!("name = \"a\"\neventually = {visited}\nlasting = \"1s\""),
                "lasting: expected only with after",
            ),
            (
                format!("name = \"a\"\neventually = {visited}\nwithin = \"1s\"\nuntil = \"2s\""),
                "within: expected within or until",
            ),
            (
                format!("name = \"a\"\nnever = {visited}\nfrom = \"2s\"\nuntil = \"2s\""),
                "until: is 2s, expected more than from, 2s",
            ),
            (
                "name = \"a\"\nnever = { visited = 0 }".to_owned(),
                "never: visited: is 0",
            ),
            (
                format!("name = \"a\"\neventually = {visited}\nwithin = \"9ms\""),
                "within: is 9ms, but the state is read each 10 ms",
            ),
            (
                "name = \"a\"\nnever = { contact = {} }\nafter = { visited = 1 }\n\
                 lasting = \"5ms\""
                    .to_owned(),
                "lasting: is 5ms",
            ),
            (
                format!("name = \"a\"\neventually = {visited}\neach = true"),
                "each: expected only with after",
            ),
            (
                format!("name = \"a\"\nsometimes = {visited}\nmay_be_unobserved = true"),
                "may_be_unobserved: expected none",
            ),
            (
                format!("name = \"a\"\nnever = {visited}\nuntil = 3"),
                "a time such as",
            ),
        ];
        for (text, said) in rows {
            let error = read(&text).expect_err(&text);
            assert!(error.contains(said), "{text}: {error}");
        }
    }
}
