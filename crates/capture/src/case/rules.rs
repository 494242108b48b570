//! Rules for the correct behaviour of a program, given by the user: `hilrig case from --expect
//! RULE`.

use core::str::FromStr;
use core::time::Duration;

use protocols::Instant;

use super::Expectation;
use crate::replay::Played;
use engine::hex;
use engine::run::check::Check;
use engine::scenario::Span;

/// One rule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Rule {
    /// The program stays alive, and neither hangs nor spins; every case requires this.
    Lives,
    /// The program sends to the end: on this link, or on all on which it sent in the capture.
    Talks(Option<String>),
    /// The program ends with this exit code.
    Exits(i32),
    /// The program prints a line with this text.
    Prints(String),
    /// The program prints no line with this text.
    NeverPrints(String),
    /// The program sends these bytes: `LINK:HEX`, or `HEX` on any link.
    Sends(String),
    /// The program never sends these bytes.
    NeverSends(String),
    /// The program behaves as if damaged frames had not arrived.
    IgnoresDamage,
    /// The program never pauses for longer than this once it has begun to send.
    Recovers(Duration),
}

/// All forms of a rule, for messages.
const FORMS: &str = "no-crash, no-hang, talks, talks=LINK, exits=CODE, prints=TEXT, \
    never-prints=TEXT, sends=[LINK:]HEX, never-sends=[LINK:]HEX, ignores-damage, recovers=TIME";

impl FromStr for Rule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) = match text.split_once('=') {
            Some((name, value)) => (name, Some(value)),
            None => (text, None),
        };
        let wanted = |what: &str| format!("{name}: expected {what}");
        let value_of = |what: &str| match value {
            Some(value) if !value.is_empty() => Ok(value.to_owned()),
            _ => Err(wanted(what)),
        };
        let bytes = || {
            let value = value_of("bytes in hex, e.g. sends=base:AB2404")?;
            match pattern(&value) {
                Some(_) => Ok(value),
                None => Err(wanted("bytes in hex, e.g. sends=base:AB2404")),
            }
        };
        match (name, value) {
            ("no-crash" | "no-hang", None) => Ok(Self::Lives),
            ("talks" | "keeps-talking", None) => Ok(Self::Talks(None)),
            ("talks" | "keeps-talking", _) => Ok(Self::Talks(Some(value_of("a link")?))),
            ("exits", _) => {
                let code = value_of("an exit code, e.g. exits=0")?;
                let code = code.parse();
                Ok(Self::Exits(
                    code.map_err(|_| wanted("an exit code, e.g. exits=0"))?,
                ))
            }
            ("prints", _) => Ok(Self::Prints(value_of("a text")?)),
            ("never-prints", _) => Ok(Self::NeverPrints(value_of("a text")?)),
            ("sends", _) => Ok(Self::Sends(bytes()?)),
            ("never-sends", _) => Ok(Self::NeverSends(bytes()?)),
            ("ignores-damage", None) => Ok(Self::IgnoresDamage),
            ("recovers", _) => {
                let what = "a time, e.g. recovers=500ms";
                let span: Result<Span, _> = value_of(what)?.parse();
                Ok(Self::Recovers(span.map_err(|_| wanted(what))?.0))
            }
            _ => Err(format!("unknown rule \"{text}\"; expected one of {FORMS}")),
        }
    }
}

/// The link that the text of some bytes names.
pub(super) fn link_of(text: &str) -> Option<&str> {
    pattern(text)?.0
}

/// The bytes, and their link if the text names one.
fn pattern(text: &str) -> Option<(Option<&str>, Vec<u8>)> {
    let (link, digits) = match text.split_once(':') {
        Some((link, digits)) => (Some(link), digits),
        None => (None, text),
    };
    let joined: String = digits.split_ascii_whitespace().collect();
    let bytes = hex::bytes(&joined)?;
    (!bytes.is_empty()).then_some((link, bytes))
}

impl Rule {
    /// The link that the rule names.
    pub fn link(&self) -> Option<&str> {
        match self {
            Self::Talks(link) => link.as_deref(),
            Self::Sends(bytes) | Self::NeverSends(bytes) => link_of(bytes),
            _ => None,
        }
    }
}

impl Expectation {
    /// Adds `rule`; `talking` are the links on which the program sent in the capture.
    pub fn add(&mut self, rule: Rule, talking: &[String]) {
        match rule {
            Rule::Lives => {}
            Rule::Talks(None) => self.talks = talking.to_vec(),
            Rule::Talks(Some(link)) => self.talks.push(link),
            Rule::Exits(code) => self.exits = Some(code),
            Rule::Prints(text) => self.prints.push(text),
            Rule::NeverPrints(text) => self.never_prints.push(text),
            Rule::Sends(bytes) => self.sends.push(bytes),
            Rule::NeverSends(bytes) => self.never_sends.push(bytes),
            Rule::IgnoresDamage => self.ignores_damage = true,
            Rule::Recovers(within) => self.recovers_ns = u64::try_from(within.as_nanos()).ok(),
        }
        self.talks.sort();
        self.talks.dedup();
    }

    /// The rules as text.
    pub fn in_words(&self) -> Vec<String> {
        let mut words = Vec::new();
        words.extend(
            self.exits
                .map(|code| format!("it ends with exit code {code}")),
        );
        words.extend(self.prints.iter().map(|text| format!("it prints {text:?}")));
        let never = self.never_prints.iter();
        words.extend(never.map(|text| format!("it never prints {text:?}")));
        words.extend(self.sends.iter().map(|bytes| format!("it sends {bytes}")));
        let never = self.never_sends.iter();
        words.extend(never.map(|bytes| format!("it never sends {bytes}")));
        let damage = "it behaves as if damaged frames had not arrived".to_owned();
        words.extend(self.ignores_damage.then_some(damage));
        words.extend(self.recovers_ns.map(|nanos| {
            let within = Duration::from_nanos(nanos).as_secs_f64();
            format!("it never pauses for longer than {within} s")
        }));
        if let Some(sound) = &self.sound {
            let lines = sound.prints.lines().count();
            words.push(format!(
                "it behaves as the reference program, which printed {lines} lines"
            ));
        }
        words
    }
}

/// Observations of a program.
#[derive(Clone, Copy, Debug)]
pub struct Evidence<'a> {
    /// Its bytes on each link.
    pub links: &'a [Played],
    /// Everything that it printed.
    pub said: &'a str,
    /// Exit code, if it ended by itself.
    pub exit_code: Option<i32>,
    /// Time of its end, if it ended.
    pub ended_at: Option<Instant>,
    /// End of the session.
    pub end: Instant,
}

impl Expectation {
    /// Verdicts on all rules except those about damage and the reference program.
    pub(super) fn judge_rules(&self, seen: &Evidence<'_>) -> Vec<Check> {
        let mut checks = Vec::new();
        if let Some(code) = self.exits {
            let detail = match seen.exit_code {
                Some(got) => format!("ended with exit code {got}, expected {code}"),
                None => format!("did not end by itself, expected exit code {code}"),
            };
            checks.push(Check::new("exits", seen.exit_code == Some(code), detail));
        }
        for text in &self.prints {
            let line = seen.said.lines().find(|line| line.contains(text.as_str()));
            let detail = match line {
                Some(line) => format!("line {line:?}"),
                None => format!("no line with {text:?}"),
            };
            checks.push(Check::new("prints", line.is_some(), detail));
        }
        for text in &self.never_prints {
            let line = seen.said.lines().find(|line| line.contains(text.as_str()));
            let detail = match line {
                Some(line) => format!("line {line:?} has {text:?}"),
                None => format!("no line with {text:?}"),
            };
            checks.push(Check::new("never-prints", line.is_none(), detail));
        }
        for (name, patterns, wanted) in [
            ("sends", &self.sends, true),
            ("never-sends", &self.never_sends, false),
        ] {
            for text in patterns {
                let found = find(text, seen.links);
                let wrong = match pattern(text) {
                    None => Some(format!("{text}: expected bytes in hex, e.g. base:AB2404")),
                    Some((Some(link), _)) => unknown_link(link, seen.links),
                    Some((None, _)) => None,
                };
                let is_sound = wrong.is_none();
                let detail = wrong.unwrap_or_else(|| match &found {
                    Some((link, at)) => format!("{text} on {link} at {at} s"),
                    None => format!("{text} was not sent"),
                });
                checks.push(Check::new(
                    name,
                    is_sound && found.is_some() == wanted,
                    detail,
                ));
            }
        }
        if let Some(nanos) = self.recovers_ns {
            checks.push(recovers(Duration::from_nanos(nanos), seen));
        }
        checks
    }
}

/// The error for a link that the session does not have.
fn unknown_link(link: &str, links: &[Played]) -> Option<String> {
    let names: Vec<&str> = links.iter().map(|one| &*one.link).collect();
    let is_known = names.contains(&link);
    (!is_known).then(|| format!("there is no link {link}, expected {}", names.join(" or ")))
}

/// The first link and time of the bytes in `text`.
fn find(text: &str, links: &[Played]) -> Option<(String, Instant)> {
    let (link, bytes) = pattern(text)?;
    let mut links = links
        .iter()
        .filter(|one| link.is_none_or(|link| one.link == link));
    links.find_map(|one| {
        let mut windows = one.got.bytes().windows(bytes.len());
        let place = windows.position(|window| window == bytes)?;
        let at = one.got.time_of(place + bytes.len() - 1)?;
        Some((one.link.clone(), at))
    })
}

/// Checks the longest pause of a program that has begun to send.
fn recovers(within: Duration, seen: &Evidence<'_>) -> Check {
    let mut times: Vec<Instant> = Vec::new();
    for link in seen.links {
        times.extend(link.got.pieces().map(|(at, _)| at));
    }
    times.sort_unstable();
    let end = seen.ended_at.unwrap_or(seen.end);
    let ends = times.iter().copied().skip(1).chain([end]);
    let pauses = times.iter().zip(ends).map(|(&from, to)| (to - from, from));
    let longest = pauses.max_by_key(|&(pause, from)| (pause, core::cmp::Reverse(from)));
    let (is_short, detail) = match longest {
        None => (false, "it sent nothing".to_owned()),
        Some((pause, from)) => {
            let (pause_s, limit) = (pause.as_secs_f64(), within.as_secs_f64());
            let detail = format!("longest pause {pause_s:.3} s from {from} s on, limit {limit} s");
            (pause <= within, detail)
        }
    };
    Check::new("recovers", is_short, detail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::divergence::Track;
    use engine::run::check::Status;

    fn rule(text: &str) -> Rule {
        text.parse().expect("a rule")
    }

    #[test]
    fn rules_are_read_from_text() {
        assert_eq!(rule("no-hang"), Rule::Lives);
        assert_eq!(rule("talks"), Rule::Talks(None));
        assert_eq!(
            rule("keeps-talking=base"),
            Rule::Talks(Some("base".to_owned()))
        );
        assert_eq!(rule("exits=3"), Rule::Exits(3));
        assert_eq!(rule("prints=a=b"), Rule::Prints("a=b".to_owned()));
        assert_eq!(
            rule("sends=base:AB 24"),
            Rule::Sends("base:AB 24".to_owned())
        );
        assert_eq!(
            rule("recovers=500ms"),
            Rule::Recovers(Duration::from_millis(500))
        );
        for (text, expected) in [
            ("exits=soon", "exits: expected an exit code, e.g. exits=0"),
            (
                "sends=base:AB2",
                "sends: expected bytes in hex, e.g. sends=base:AB2404",
            ),
            ("prints", "prints: expected a text"),
            (
                "recovers=x",
                "recovers: expected a time, e.g. recovers=500ms",
            ),
        ] {
            assert_eq!(text.parse::<Rule>(), Err(expected.to_owned()));
        }
        let unknown = "flies".parse::<Rule>().expect_err("no rule");
        assert!(unknown.starts_with("unknown rule \"flies\"; expected one of no-crash, "));
    }

    /// Bytes at 1, 2 and 4 s, printed lines, exit code 3 at 5 s of 9 s.
    fn judged(rules: &[&str]) -> Vec<(String, Status, String)> {
        let mut got = Track::default();
        for (at, bytes) in [(1, &[0xAB, 1][..]), (2, &[2, 3]), (4, &[4])] {
            got.push(Instant::from_secs(at), bytes);
        }
        let links = [Played {
            link: "base".to_owned(),
            expected: Track::default(),
            got,
            talk: None,
        }];
        let mut expect = Expectation::default();
        rules.iter().for_each(|text| expect.add(rule(text), &[]));
        let checks = expect.judge_rules(&Evidence {
            links: &links,
            said: "depth 7\nreconnect\n",
            exit_code: Some(3),
            ended_at: Some(Instant::from_secs(5)),
            end: Instant::from_secs(9),
        });
        let checks = checks.into_iter();
        checks
            .map(|one| (one.name, one.status, one.detail))
            .collect()
    }

    #[test]
    fn each_rule_passes_and_fails_by_what_was_seen() {
        let pairs = [
            ("exits=3", "exits=0"),
            ("prints=depth", "prints=death"),
            ("never-prints=death", "never-prints=reconnect"),
            ("sends=0102", "sends=0103"),
            ("sends=base:02 03 04", "sends=radio:0102"),
            ("never-sends=0103", "never-sends=base:0102"),
            ("recovers=2s", "recovers=1999ms"),
        ];
        for (good, bad) in pairs {
            let verdict = |text: &str| judged(&[text])[0].1;
            assert_eq!(
                (verdict(good), verdict(bad)),
                (Status::Pass, Status::Fail),
                "{good}"
            );
        }
        let said = &judged(&["sends=0203"])[0].2;
        assert_eq!(said, "0203 on base at 2.000000 s");
        let pause = &judged(&["recovers=1s"])[0].2;
        assert_eq!(pause, "longest pause 2.000 s from 2.000000 s on, limit 1 s");
    }

    #[test]
    fn a_rule_names_a_link() {
        for (text, link) in [
            ("talks=base", Some("base")),
            ("talks", None),
            ("sends=base:AB", Some("base")),
            ("never-sends=lidar:AB", Some("lidar")),
            ("sends=AB", None),
            ("exits=1", None),
            ("ignores-damage", None),
        ] {
            let rule: Rule = text.parse().expect(text);
            assert_eq!(rule.link(), link, "{text}");
        }
        for text in [
            "prints=",
            "talks=",
            "ignores-damage=1",
            "no-crash=1",
            "exits=x",
        ] {
            assert!(text.parse::<Rule>().is_err(), "{text}");
        }
    }

    #[test]
    fn all_rules_have_words() {
        let mut expect = Expectation::default();
        assert!(expect.in_words().is_empty());
        for text in [
            "exits=3",
            "prints=hello",
            "never-prints=panic",
            "sends=base:AB",
            "never-sends=CD",
            "ignores-damage",
            "recovers=500ms",
        ] {
            expect.add(text.parse().expect(text), &[]);
        }
        assert_eq!(
            expect.in_words(),
            [
                "it ends with exit code 3",
                "it prints \"hello\"",
                "it never prints \"panic\"",
                "it sends base:AB",
                "it never sends CD",
                "it behaves as if damaged frames had not arrived",
                "it never pauses for longer than 0.5 s",
            ]
        );
    }
}
