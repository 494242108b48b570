//! Names of links and devices in the expectations of a case. An unknown one is an error of the
//! file: as a verdict it would blame the program, and "never" would hold.

use std::collections::BTreeSet;

use super::rules::link_of;
use super::{Case, CaseError, Play};
use engine::near;
use engine::robots::{self, Dut, PcEnd};
use engine::scenario::Source;

impl Case {
    /// The links of the tested program, and the devices that judge it; `None`: they are not known.
    fn known(&self, source: &Source) -> (Option<BTreeSet<String>>, Option<BTreeSet<String>>) {
        let wired = |dut| {
            let scenario = self.scenario.as_ref()?;
            robots::wire(scenario, source, dut, PcEnd::Scripted).ok()
        };
        let names = |wired: &robots::Wired| wired.rig.device_names().map(str::to_owned).collect();
        match self.play {
            Some(Play::Devices) => {
                let wired = wired(Dut::External);
                let ends = wired.as_ref().map(|wired| {
                    let ends = wired.open_ends.iter();
                    ends.map(|end| end.link.clone()).collect()
                });
                (ends, wired.as_ref().map(names))
            }
            _ => {
                let links = self.link.iter().map(|link| link.name.clone());
                let devices = self.expect.never.first().and_then(|_| wired(Dut::Internal));
                (Some(links.collect()), devices.as_ref().map(names))
            }
        }
    }

    /// The links of the tested program; `None` if they are not known.
    pub fn links(&self, source: &Source) -> Option<BTreeSet<String>> {
        self.known(source).0
    }

    /// The links and devices that the expectations name, each with its key and the text of it in
    /// the file.
    fn named(&self) -> Vec<(String, &str, &str, bool)> {
        let expect = &self.expect;
        let key = |list: &str, index: usize| format!("expect.{list}[{index}]");
        let mut named = Vec::new();
        for (index, link) in expect.talks.iter().enumerate() {
            named.push((key("talks", index), &**link, &**link, true));
        }
        for (list, patterns) in [
            ("sends", &expect.sends),
            ("never_sends", &expect.never_sends),
        ] {
            for (index, text) in patterns.iter().enumerate() {
                if let Some(link) = link_of(text) {
                    named.push((key(list, index), link, text, true));
                }
            }
        }
        for (index, decoded) in expect.decoder.iter().enumerate() {
            let link = &*decoded.link;
            named.push((format!("expect.decoder[{index}].link"), link, link, true));
        }
        for (index, rule) in expect.never.iter().enumerate() {
            let device = rule.split(' ').next().unwrap_or_default();
            named.push((key("never", index), device, rule, false));
        }
        named
    }

    /// The reason why `ignores_damage` cannot be judged: devices answer anew and send no captured
    /// damage.
    pub fn why_damage_is_not_judged(&self) -> Option<&'static str> {
        (self.play == Some(Play::Devices)).then_some(
            "is not judged if the devices answer, because the captured damage does not arrive; \
             use --play conversation, or --sound CMD in place of this rule",
        )
    }

    /// Checks that the source of the answers lets each expectation be judged.
    ///
    /// # Errors
    /// For an expectation that would never be judged.
    pub(super) fn check_play(&self, source: &Source) -> Result<(), CaseError> {
        let why = self.why_damage_is_not_judged();
        why.filter(|_| self.expect.ignores_damage)
            .map_or(Ok(()), |why| {
                let span = source.find("ignores_damage");
                let key = "expect.ignores_damage".to_owned();
                Err(CaseError::File(source.invalid(span, key, why.to_owned())))
            })
    }

    /// Checks that the case has the links and devices that its expectations name.
    ///
    /// # Errors
    /// For the first unknown name, with all known ones.
    pub fn check_names(&self, source: &Source) -> Result<(), CaseError> {
        let named = self.named();
        if named.is_empty() {
            return Ok(());
        }
        let (links, devices) = self.known(source);
        for (key, name, text, is_link) in named {
            let known = if is_link { &links } else { &devices };
            let Some(known) = known.as_ref().filter(|known| !known.contains(name)) else {
                continue;
            };
            let all: Vec<&str> = known.iter().map(String::as_str).collect();
            let kind = if is_link { "link" } else { "device" };
            let message = format!("the {kind} {}", near::expected(name, &all));
            let span = source.find(&format!("\"{text}\""));
            return Err(CaseError::File(source.invalid(span, key, message)));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    const HEAD: &str = "case = 1\nname = \"x\"\nend_ns = 1000000000\nforeign = true\n";
    const LINKS: &str = "[[link]]\nname = \"base\"\nbaud = 9600\nto_program = \"10 AB\"\n\
                         [[link]]\nname = \"radio\"\nbaud = 9600\nto_program = \"10 AB\"\n";
    const ROBOT: &str = "[scenario]\nschema = 1\nname = \"s\"\nrobot = \"none\"\n\
                         duration = \"2s\"\n[scenario.device]\n\
                         meter = { description = \"gps\" }\n";

    fn error(play: &str, expect: &str, rest: &str) -> Option<String> {
        let text = format!("{HEAD}play = \"{play}\"\n[expect]\n{expect}\n{rest}");
        let read = Case::parse(Path::new("x.toml"), text);
        read.err().map(|error| error.to_string())
    }

    /// Line 7 of the file is the first expectation.
    #[test]
    fn each_name_of_an_expectation_is_known() {
        for (expect, rest) in [
            ("talks = [\"base\"]", LINKS),
            ("sends = [\"base:AB\", \"AB\"]", LINKS),
            ("never_sends = [\"radio:AB 24\"]", LINKS),
            ("prints = [\"no link\"]", LINKS),
        ] {
            assert_eq!(error("conversation", expect, rest), None, "{expect}");
        }
        for (key, expect) in [
            ("expect.talks[0]", "talks = [\"bass\"]"),
            ("expect.sends[1]", "sends = [\"AB\",\n\"bass:AB\"]"),
            ("expect.never_sends[0]", "never_sends = [\"bass:AB\"]"),
        ] {
            let error = error("conversation", expect, LINKS).expect(key);
            let line = if expect.contains('\n') { 8 } else { 7 };
            let expected = format!(
                "x.toml:{line}: {key}: the link is \"bass\", did you mean \"base\"? Expected one \
                 of base, radio"
            );
            assert_eq!(error, expected);
        }
    }

    #[test]
    fn a_rule_that_is_never_judged_is_an_error() {
        let rule = "ignores_damage = true";
        assert_eq!(error("conversation", rule, LINKS), None);
        let error = error("devices", rule, ROBOT).expect("not judged");
        let expected = "x.toml:7: expect.ignores_damage: is not judged if the devices answer";
        assert!(error.starts_with(expected), "{error}");
        assert!(error.contains("--play conversation"), "{error}");
    }

    /// The devices of a scenario give the links and judge.
    #[test]
    fn a_case_with_devices_has_their_names() {
        let good = "talks = [\"meter\"]\nnever = [\"meter bad-frame\"]";
        assert_eq!(error("devices", good, ROBOT), None);
        for (expect, kind) in [
            ("talks = [\"base\"]", "link"),
            ("never = [\"base bad-frame\"]", "device"),
        ] {
            let error = error("devices", expect, ROBOT).expect("unknown");
            let wanted = format!("the {kind} is \"base\", expected one of meter");
            assert!(
                error.starts_with("x.toml:7: ") && error.ends_with(&wanted),
                "{error}"
            );
        }
    }
}
