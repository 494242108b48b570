//! `monitor` commands: information of the rig while the program stands.

use core::str::FromStr as _;

use super::Session;
use crate::guest::supervisor::Goal;
use engine::run::check::Status;
use engine::scenario::{Condition, FaultSpec, Span};

/// Number of lines that `wires` prints without a number.
const WIRES: usize = 20;
/// Maximum number of events that `state` prints.
const EVENTS: usize = 5;

const HELP: &str = "\
monitor time                 the rig's time, the program's time, and the number of this place
monitor until 12.3s          the next continue stops at that time of the rig
monitor until visited 3      the same for a condition of a mission step (docs/scenario.md):
                             KEY VALUE as in TOML
monitor back 200ms           the next reverse-continue goes back by that time of the rig
monitor wires LINK [N]       the last N pieces of bytes that arrived on a link [default: 20]
monitor state                pose, waypoints, ports, the last events
monitor verdict              the checks as they would be if the run ended now
monitor fault add KEY=VALUE..  adds a fault, as hilrig fault does; the run is another one then
monitor help                 this text";

impl Session<'_> {
    /// Output of `monitor COMMAND`.
    pub(super) fn monitor(&mut self, command: &str) -> String {
        let mut words = command.split_whitespace();
        let verb = words.next().unwrap_or("help");
        let rest: Vec<&str> = words.collect();
        let answer = match (verb, &rest[..]) {
            ("help", _) => Ok(HELP.to_owned()),
            ("time", []) => Ok(self.time()),
            ("until", until) => self.until(until),
            ("back", [by]) => self.back_by(by),
            ("wires", rest) => self.wires_of(rest),
            ("state", []) => Ok(self.state()),
            ("verdict", []) => Ok(self.verdict()),
            ("fault", ["add", pairs @ ..]) => self.add_fault(pairs),
            _ => Err(format!(
                "{command}: unknown; expected time, until, back, wires, state, verdict, fault add \
                 or help"
            )),
        };
        answer.unwrap_or_else(|error| format!("error: {error}"))
    }

    fn time(&mut self) -> String {
        let (rig, own) = (self.trial().now(), self.trial().waited());
        let own = protocols::Instant::ZERO + own;
        let debugging = self.supervisor().debugging();
        let place = debugging.map(|it| it.place().to_string());
        let begun = match self.trial().has_begun() {
            true => "",
            false => " (stands until the program has opened its ports)",
        };
        format!(
            "rig {rig} s{begun}, program {own} s, {}",
            place.unwrap_or_default()
        )
    }

    fn until(&mut self, words: &[&str]) -> Result<String, String> {
        let expected = "expected a time such as 12.3s, or KEY VALUE such as visited 3";
        let (goal, text) = match words {
            [] => return Err(format!("until: {expected}")),
            [time] => {
                let span = Span::from_str(time).map_err(|_| format!("until {time}: {expected}"))?;
                let at = span.instant();
                if at <= self.trial().now() {
                    let now = self.trial().now();
                    return Err(format!("until {time}: the rig is at {now} s already"));
                }
                (Goal::Time(at), format!("{at} s"))
            }
            [key, value @ ..] => {
                let toml = format!("{key} = {}", value.join(" "));
                let condition: Condition = toml::from_str(&toml)
                    .map_err(|error| format!("until {toml}: {}; {expected}", error.message()))?;
                let watch = self.trial().run().watch(&condition);
                let watch = watch.map_err(|flaw| format!("until {toml}: {flaw}"))?;
                (Goal::Condition(Box::new(watch)), toml)
            }
        };
        if let Some(debugging) = self.supervisor().debugging() {
            debugging.set_goal(Some(goal));
        }
        Ok(format!("the next continue stops at {text}"))
    }

    fn back_by(&mut self, by: &str) -> Result<String, String> {
        let wrong = |_| format!("back {by}: expected a time such as 200ms");
        let by = Span::from_str(by).map_err(wrong)?;
        let since = self.trial().now() - protocols::Instant::ZERO;
        let at = protocols::Instant::ZERO + since.saturating_sub(by.0);
        self.back_to = Some(at);
        Ok(format!("the next reverse-continue goes back to {at} s"))
    }

    fn wires_of(&mut self, words: &[&str]) -> Result<String, String> {
        let links = self.trial().run().rig.links();
        let names: Vec<String> = links.iter().map(|link| link.name.clone()).collect();
        let all = names.join(", ");
        let (name, count) = match words {
            [name] => (name, WIRES),
            [name, count] => {
                let parsed = count.parse();
                let wrong = |_| format!("wires {name} {count}: expected a number of pieces");
                (name, parsed.map_err(wrong)?)
            }
            _ => {
                return Err(format!(
                    "wires: expected a link of {all}, and how many pieces"
                ));
            }
        };
        let link = names.iter().position(|other| other == name);
        let link = link.ok_or_else(|| format!("wires {name}: expected a link of {all}"))?;
        let lines = self.wires.last(link, count);
        Ok(match lines.is_empty() {
            true => format!("no byte has arrived on {name} yet"),
            false => lines.join("\n"),
        })
    }

    fn state(&mut self) -> String {
        let (has_begun, run) = (self.trial().has_begun(), self.trial().run());
        let pose = run.rig.world.pose();
        let progress = run.progress();
        let mut lines = vec![
            format!(
                "{} s{}",
                run.rig.now(),
                if has_begun { "" } else { ", not begun" }
            ),
            format!(
                "pose {:.3} m, {:.3} m, {:.1} deg; waypoints {} of {}; violations {}",
                pose.x,
                pose.y,
                pose.theta.to_degrees(),
                progress.visits().len(),
                progress.waypoints(),
                run.rig.violations()
            ),
        ];
        let events = run.rig.events();
        let last = &events[events.len().saturating_sub(EVENTS)..];
        lines.extend(last.iter().map(ToString::to_string));
        lines.join("\n")
    }

    fn verdict(&mut self) -> String {
        let checks = self.trial().checks_now();
        let lines = checks.iter().map(|check| {
            let status = match check.status {
                Status::Pass => "pass",
                Status::Fail => "FAIL",
                Status::NotObserved => "not observed",
            };
            format!("{status:<12} {}: {}", check.name, check.detail)
        });
        let lines: Vec<String> = lines.collect();
        lines.join("\n")
    }

    fn add_fault(&mut self, pairs: &[&str]) -> Result<String, String> {
        let mut keys = serde_json::Map::new();
        for pair in pairs {
            let (key, value) = pair
                .split_once('=')
                .ok_or_else(|| format!("fault add: \"{pair}\": expected KEY=VALUE"))?;
            let table = toml::from_str::<toml::Table>(&format!("v = {value}"));
            let value = table
                .ok()
                .and_then(|table| serde_json::to_value(table.get("v")?).ok());
            keys.insert(
                key.to_owned(),
                value.unwrap_or_else(|| pair[key.len() + 1..].into()),
            );
        }
        let fault = FaultSpec::of_json(&keys).map_err(|flaws| {
            let flaws = flaws
                .iter()
                .map(|(key, message)| format!("{key}: {message}"));
            format!("fault add: {}", flaws.collect::<Vec<_>>().join("; "))
        })?;
        let added = self.trial().run().inject(fault);
        let id = added.map_err(|flaw| format!("fault add: {flaw}"))?;
        Ok(format!("fault {} from now on", id.0))
    }
}
