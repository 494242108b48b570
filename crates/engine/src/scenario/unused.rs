//! Valid keys without an effect in their scenario: each is a warning that names file, line and key.
//! Impossible values are errors elsewhere.

use toml::Spanned;

use super::condition::{Op, Operand};
use super::{
    AccessSpec, Condition, NO_ROBOT, RegistersSpec, Scenario, ScenarioError, Source, SourceSpec,
    Span, TextSpec,
};

impl Scenario {
    /// The keys of `source` without effect.
    pub fn warnings(&self, source: &Source) -> Vec<ScenarioError> {
        let mut found = Warnings {
            source,
            found: Vec::new(),
        };
        for (name, spec) in &self.device {
            if let Some(spec) = spec.settings::<RegistersSpec>() {
                found.of_registers(&format!("device.{name}.registers"), spec);
            }
            if let Some(spec) = spec.settings::<TextSpec>() {
                found.of_text(&format!("device.{name}.text"), spec);
            }
        }
        found.of_times(self);
        found.of_nothing(self);
        found.of_conditions(self);
        found.of_robot(self);
        let expect = &self.expect;
        if expect.wall_within_mm.is_some() && expect.wall_overlap_min.is_none() {
            let message = "has no effect without wall_overlap_min";
            found.add(
                "wall_within_mm",
                "expect.wall_within_mm".to_owned(),
                message,
            );
        }
        found.found
    }
}

impl Scenario {
    /// All conditions, each with its list, its number there, and its key.
    pub(crate) fn conditions(
        &self,
    ) -> impl Iterator<Item = (&'static str, usize, &'static str, &Condition)> {
        let rules = self.expect.rule.iter().enumerate();
        let rules = rules.flat_map(|(index, rule)| {
            let all = rule.get_ref().conditions();
            all.map(move |(key, one)| ("expect.rule", index, key, one))
        });
        let steps = self.mission.step.iter().enumerate();
        let steps = steps
            .filter_map(|(index, step)| Some(("mission.step", index, "when", step.when.as_ref()?)));
        let faults = self.fault.iter().enumerate();
        let faults = faults.flat_map(|(index, fault)| {
            let all = fault.conditions();
            all.map(move |(key, one)| ("fault", index, key, one))
        });
        rules.chain(steps).chain(faults)
    }
}

struct Warnings<'a> {
    source: &'a Source,
    found: Vec<ScenarioError>,
}

/// A value of a slave, whatever its protocol.
struct Value<'a> {
    key: String,
    span: core::ops::Range<usize>,
    source: &'a SourceSpec,
    /// Whether a master can set the value.
    is_set: bool,
    limits: bool,
    safe: bool,
}

impl Warnings<'_> {
    fn add(&mut self, name: &str, key: String, message: &str) {
        let span = self.source.find(name);
        self.found.push(self.source.invalid(span, key, message));
    }

    fn at(&mut self, span: core::ops::Range<usize>, key: String, message: &str) {
        self.found
            .push(self.source.invalid(Some(span), key, message));
    }

    fn of_registers(&mut self, key: &str, spec: &RegistersSpec) {
        let values = spec.register.iter().enumerate().map(|(index, spanned)| {
            let one = spanned.get_ref();
            Value {
                key: format!("{key}.register[{index}]"),
                span: spanned.span(),
                source: &one.source,
                is_set: one.access == AccessSpec::Write,
                limits: one.limits.is_some(),
                safe: one.safe.is_some(),
            }
        });
        self.of_values(key, values.collect(), spec.watchdog.is_some());
        if spec.boot.is_some() && spec.resets_on.is_none() {
            self.add("boot", format!("{key}.boot"), NO_RESET);
        }
    }

    fn of_text(&mut self, key: &str, spec: &TextSpec) {
        let is_set = |name: &str| {
            let placeholder = format!("{{{name}}}");
            let mut requests = spec.command.iter().map(Spanned::get_ref);
            requests.any(|command| command.request.contains(&placeholder))
        };
        let values = spec.variable.iter().enumerate().map(|(index, spanned)| {
            let one = spanned.get_ref();
            Value {
                key: format!("{key}.variable[{index}]"),
                span: spanned.span(),
                source: &one.source,
                is_set: is_set(&one.name),
                limits: one.limits.is_some(),
                safe: one.safe.is_some(),
            }
        });
        self.of_values(key, values.collect(), spec.watchdog.is_some());
        if spec.resets_on.is_none() {
            for (name, is_given) in [
                ("boot", spec.boot.is_some()),
                ("greeting", spec.greeting.is_some()),
            ] {
                if is_given {
                    self.add(name, format!("{key}.{name}"), NO_RESET);
                }
            }
        }
    }

    fn of_values(&mut self, key: &str, values: Vec<Value<'_>>, has_watchdog: bool) {
        if has_watchdog && !values.iter().any(|value| value.safe) {
            let message = "has no effect: no value of the device sets \"safe\"";
            self.add("watchdog", format!("{key}.watchdog"), message);
        }
        for value in values {
            let has_source = *value.source != SourceSpec::Stored;
            if value.limits && (has_source || !value.is_set) {
                let message = "has no effect: limits apply to values from a master, and no master can set this value";
                self.at(value.span.clone(), format!("{}.limits", value.key), message);
            }
            if value.safe && has_source {
                let message = "has no effect: the value has a source";
                self.at(value.span.clone(), format!("{}.safe", value.key), message);
            } else if value.safe && !has_watchdog {
                let message = "has no effect: the device has no watchdog that would set it";
                self.at(value.span, format!("{}.safe", value.key), message);
            }
        }
    }

    /// Events after the end of the run.
    fn of_times(&mut self, scenario: &Scenario) {
        let end = scenario.duration;
        let late = |at| format!("has no effect: the run ends at {end}, and this is at {at}");
        for (index, fault) in scenario.fault.iter().enumerate() {
            if let Some(from) = fault.from.filter(|from| *from >= end) {
                let span = self.source.find_in_list("fault", index, "from");
                let key = format!("fault[{index}].from");
                self.found.push(self.source.invalid(span, key, late(from)));
            }
        }
        for (index, step) in scenario.mission.step.iter().enumerate() {
            if let Some(at) = step.at.filter(|at| *at >= end) {
                let span = self.source.find_in_list("mission.step", index, "at");
                let key = format!("mission.step[{index}].at");
                self.found.push(self.source.invalid(span, key, late(at)));
            }
        }
        for (index, rule) in scenario.expect.rule.iter().enumerate() {
            for (key, at) in rule.get_ref().times_beyond(end) {
                let span = self.source.find_in_list("expect.rule", index, key);
                let span = span.or(Some(rule.span()));
                let key = format!("expect.rule[{index}].{key}");
                self.found.push(self.source.invalid(span, key, late(at)));
            }
        }
        let safety = scenario.expect.safety.clone().unwrap_or_default();
        for (name, within) in [
            ("rests_within", safety.rests_within),
            ("obeys_within", safety.obeys_within),
            ("commands_within", safety.commands_within),
            ("sends_within", safety.sends_within),
            ("says_within", safety.says_within),
        ] {
            if within.is_some_and(|within| within >= end) {
                let message = format!("has no effect: the run ends at {end}");
                self.add(name, format!("expect.safety.{name}"), &message);
            }
        }
        for (index, push) in scenario.world.push.iter().enumerate() {
            if push.at >= end {
                let span = self.source.find_in_list("world.push", index, "at");
                let key = format!("world.push[{index}].at");
                self.found
                    .push(self.source.invalid(span, key, late(push.at)));
            }
        }
    }

    /// Faults of size 0, and watchdogs that never expire.
    fn of_nothing(&mut self, scenario: &Scenario) {
        for (index, fault) in scenario.fault.iter().enumerate() {
            let zeros = [
                ("rate", fault.rate == Some(0.0)),
                ("by", fault.by == Some(Span::default())),
                ("count", fault.count == Some(0)),
            ];
            for (key, _) in zeros.into_iter().filter(|(_, is_zero)| *is_zero) {
                let span = self.source.find_in_list("fault", index, key);
                let key = format!("fault[{index}].{key}");
                let message = "has no effect: it is 0, so the fault changes nothing";
                self.found.push(self.source.invalid(span, key, message));
            }
        }
        let is_zero = |span: Option<Span>| span == Some(Span::default());
        let phases = scenario.phases;
        let budget = scenario.budget.unwrap_or_default();
        let no_fault = "is 0: no random fault acts";
        let zeros = [
            (
                "adversity",
                is_zero(phases.map(|it| it.adversity)),
                "phases.adversity",
                no_fault,
            ),
            (
                "judgement",
                is_zero(phases.map(|it| it.judgement)),
                "phases.judgement",
                "has no effect: it is 0, so nothing is judged in it",
            ),
            ("total", budget.total == Some(0), "budget.total", no_fault),
            (
                "at_once",
                budget.at_once == Some(0),
                "budget.at_once",
                no_fault,
            ),
        ];
        for (name, _, key, message) in zeros.into_iter().filter(|(_, is_zero, ..)| *is_zero) {
            self.add(name, key.to_owned(), message);
        }
        let end = scenario.duration;
        for (name, spec) in &scenario.device {
            let registers = spec.settings::<RegistersSpec>().map(|it| it.watchdog);
            let text = spec.settings::<TextSpec>().map(|it| it.watchdog);
            let watchdog = registers.or(text).flatten();
            if let Some(after) = watchdog.filter(|after| *after >= end) {
                let key = format!("device.{name}.watchdog");
                let message =
                    format!("has no effect: the run ends at {end}, and it expires after {after}");
                self.add("watchdog", key, &message);
            }
        }
    }

    /// Conditions on registers that are always true, or never.
    fn of_conditions(&mut self, scenario: &Scenario) {
        for (list, index, key, condition) in scenario.conditions() {
            for message in constants(scenario, condition) {
                let span = self.source.find_in_list(list, index, key);
                let key = format!("{list}[{index}].{key}");
                self.found.push(self.source.invalid(span, key, message));
            }
        }
    }

    /// A world for devices without a robot.
    fn of_robot(&mut self, scenario: &Scenario) {
        if scenario.robot != NO_ROBOT {
            return;
        }
        if !scenario.world.is_nowhere() {
            let message = "has no effect: robot = \"none\" means devices on their wires alone, which \
                           sense no world; for a body with these devices set robot = \"custom\"";
            self.add("world", "world".to_owned(), message);
        }
        for (name, spec) in &scenario.device {
            let registers = spec.settings::<RegistersSpec>().into_iter();
            let registers = registers.flat_map(|spec| &spec.register);
            let registers = registers.map(|one| (one.span(), &one.get_ref().source));
            let texts = spec.settings::<TextSpec>().into_iter();
            let texts = texts.flat_map(|spec| &spec.variable);
            let texts = texts.map(|one| (one.span(), &one.get_ref().source));
            for (span, of) in registers.chain(texts) {
                if of.is_of_a_body() {
                    let message = "has no robot to measure (robot = \"none\"): it stays as at rest \
                                   in an empty world";
                    self.at(span, format!("device.{name}.source"), message);
                }
            }
            #[cfg(feature = "described")]
            self.of_description(name, spec);
        }
    }
}

#[cfg(feature = "described")]
impl Warnings<'_> {
    /// Variables of a described device that measure the world. A description that cannot be read
    /// is an error elsewhere.
    fn of_description(&mut self, name: &str, spec: &super::DeviceSpec) {
        let units = spec.settings::<super::device::description::DescriptionSpec>();
        let base = self.source.path.parent().unwrap_or_else(|| ".".as_ref());
        for unit in units.into_iter().flat_map(|spec| &spec.0) {
            let Ok(description) = unit.load(base) else {
                continue;
            };
            let measured = description.variables_of_world();
            if !measured.is_empty() {
                let message = format!(
                    "its variables {} have the source \"world\", but there is no robot to measure \
                     (robot = \"none\"): they stay as at rest in an empty world",
                    measured.join(", ")
                );
                self.add(name, format!("device.{name}.description"), &message);
            }
        }
    }
}

/// Messages on the parts of `condition` that no value of their register changes.
fn constants(scenario: &Scenario, condition: &Condition) -> Vec<String> {
    let wanted = match condition {
        Condition::All(parts) | Condition::Any(parts) => {
            let parts = parts.iter();
            return parts.flat_map(|one| constants(scenario, one)).collect();
        }
        Condition::Not(part) => return constants(scenario, part),
        Condition::Register(wanted) => wanted,
        _ => return Vec::new(),
    };
    let device = scenario.device.get(&wanted.device);
    let registers = device.and_then(|device| device.settings::<RegistersSpec>());
    let mut registers = registers.into_iter().flat_map(|spec| &spec.register);
    let register = registers.find(|register| {
        let register = register.get_ref();
        let is_at = |address| u32::from(register.address) == address;
        wanted.name.as_ref() == Some(&register.name) || wanted.address.is_some_and(is_at)
    });
    let (Some(register), Operand::Number(value)) = (register, &wanted.value) else {
        return Vec::new();
    };
    let [least, most] = register.get_ref().width.range();
    let holds = |found: f64| wanted.op.holds(&found, value);
    let is_constant = match wanted.op {
        Op::Equal | Op::Unequal => !(least..=most).contains(value) || value.fract() != 0.0,
        _ => holds(least) == holds(most),
    };
    let word = if holds(least) { "always" } else { "never" };
    let name = &register.get_ref().name;
    let message = format!(
        "has no effect: {name} {} {} is {word} true, as {name} is from {least} to {most}",
        wanted.op, wanted.value
    );
    is_constant.then_some(message).into_iter().collect()
}

const NO_RESET: &str = "has no effect: nothing restarts the board; set resets_on";

impl SourceSpec {
    /// Whether the source measures a robot or its surroundings.
    const fn is_of_a_body(&self) -> bool {
        !matches!(self, Self::Stored | Self::Counter(_) | Self::Ramp { .. })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn warnings(text: &str) -> Vec<String> {
        let head = "schema = 1\nname = \"t\"\nduration = \"5s\"\n";
        let parsed = Scenario::parse(Path::new("t.toml"), format!("{head}{text}"));
        let (scenario, source) = parsed.expect("sound");
        let warnings = scenario.warnings(&source).into_iter();
        warnings.map(|warning| warning.to_string()).collect()
    }

    const WORLD: &str = "[world]\nstart = { x_m = 1, y_m = 1, heading_deg = 0 }\n";

    /// Checks the reported lines: line 6 has the first register, line 7 the second.
    #[test]
    fn keys_of_a_slave_without_effect_are_told_with_their_lines() {
        let text = format!(
            "robot = \"custom\"\n[device.base.registers]\nbaud = 9600\nboot = \"1s\"\n\
             register = [\n\
             {{ address = 0, name = \"a\", width = \"u8\", limits = [0, 9] }},\n\
             {{ address = 1, name = \"b\", width = \"u8\", access = \"write\", safe = 0 }},\n]\n\
             {WORLD}"
        );
        let expected = [
            "t.toml:9: device.base.registers.register[0].limits: has no effect: limits apply \
             to values from a master, and no master can set this value",
            "t.toml:10: device.base.registers.register[1].safe: has no effect: the device has no \
             watchdog that would set it",
            "t.toml:7: device.base.registers.boot: has no effect: nothing restarts the board; set resets_on",
        ];
        assert_eq!(warnings(&text), expected);
        let sound = text
            .replace("boot = \"1s\"", "watchdog = \"1s\"")
            .replace(", limits = [0, 9]", "");
        assert_eq!(warnings(&sound), [""; 0]);
        let unsafe_ = sound.replace(", safe = 0", "");
        let told = "t.toml:7: device.base.registers.watchdog: has no effect: no value of the \
                    device sets \"safe\"";
        assert_eq!(warnings(&unsafe_), [told]);
    }

    #[test]
    fn what_would_come_after_the_end_is_told() {
        let text = format!(
            "robot = \"rescue\"\n{WORLD}[[fault]]\nkind = \"flip\"\nlink = \"base\"\n\
             direction = \"to-master\"\nrate = 0.5\nfrom = \"5s\"\n\
             [[mission.step]]\nat = \"9s\"\ndo = \"connect\"\n{}",
            [
                "from = \"5s\"",
                "within = \"4s\"\nlasting = \"2s\"\nfrom = \"1s\"",
                "until = \"6s\""
            ]
            .map(|times| format!(
                "[[expect.rule]]\nname = \"{0}\"\nnever = {{ visited = 1 }}\n\
                     after = {{ contact = {{}} }}\n{times}\n",
                times.len()
            ))
            .concat()
        );
        let expected = [
            "t.toml:12: fault[0].from: has no effect: the run ends at 5s, and this is at 5s",
            "t.toml:14: mission.step[0].at: has no effect: the run ends at 5s, and this is at 9s",
            "t.toml:20: expect.rule[0].from: has no effect: the run ends at 5s, and this is at 5s",
            "t.toml:25: expect.rule[1].within: has no effect: the run ends at 5s, and this is at 5s",
            "t.toml:26: expect.rule[1].lasting: has no effect: the run ends at 5s, and this is at 7s",
            "t.toml:32: expect.rule[2].until: has no effect: the run ends at 5s, and this is at 6s",
        ];
        assert_eq!(warnings(&text), expected);
    }

    /// A fault of rate 0, a watchdog of a run's length, and conditions beyond a byte, by name and
    /// by address.
    #[test]
    fn sizes_of_nothing_and_conditions_without_a_choice_are_told() {
        let rule = |name: &str, demand: &str, end: &str| {
            format!(
                "[[expect.rule]]\nname = \"{name}\"\n\
                 {demand} = {{ register = {{ device = \"base\", {end} }} }}\n"
            )
        };
        let rules = [
            rule("a", "never", "name = \"a\", op = \">\", value = 127"),
            rule("b", "always", "address = 0, op = \">=\", value = -128"),
            rule("c", "never", "name = \"a\", value = 200"),
            rule("d", "never", "name = \"a\", op = \">\", value = 126"),
            rule("e", "never", "name = \"a\", value = -128"),
        ];
        let text = format!(
            "robot = \"custom\"\n[device.base.registers]\nbaud = 9600\nwatchdog = \"5s\"\n\
             register = [\n{{ address = 0, name = \"a\", width = \"i8\", access = \"write\", \
             safe = 0 }},\n]\n[[fault]]\nkind = \"flip\"\nlink = \"base\"\n\
             direction = \"to-master\"\nrate = 0.0\n{}{WORLD}",
            rules.concat()
        );
        let expected = [
            "t.toml:15: fault[0].rate: has no effect: it is 0, so the fault changes nothing",
            "t.toml:7: device.base.watchdog: has no effect: the run ends at 5s, and it expires \
             after 5s",
            "t.toml:18: expect.rule[0].never: has no effect: a > 127 is never true, as a is from \
             -128 to 127",
            "t.toml:21: expect.rule[1].always: has no effect: a >= -128 is always true, as a is \
             from -128 to 127",
            "t.toml:24: expect.rule[2].never: has no effect: a == 200 is never true, as a is from \
             -128 to 127",
        ];
        assert_eq!(warnings(&text), expected);
    }

    #[test]
    fn a_world_and_what_measures_it_are_told_where_there_is_no_robot() {
        let text = format!(
            "robot = \"none\"\n[device.sonar.text]\nbaud = 9600\ncommand = []\n\
             [[device.sonar.text.variable]]\nname = \"mm\"\n\
             source = {{ range = {{ angle_deg = 0, max_mm = 900 }} }}\n{WORLD}"
        );
        let told = warnings(&text);
        assert!(
            told[0].starts_with("t.toml:11: world: has no effect"),
            "{told:?}"
        );
        assert!(told[1].contains("has no robot to measure"), "{told:?}");
        assert_eq!(told.len(), 2);
    }
}
