//! The fault of the scenario after which a program failed.

use core::time::Duration;
use std::collections::BTreeMap;

use protocols::Instant;

use super::{Cause, Evidence, weight};
use engine::run::Outcome;
use engine::run::check::{Check, Status};
use engine::scenario::{DirectionSpec, FaultKind, FaultSpec};

/// Maximum time between a fault and its effect.
const SOON: Duration = Duration::from_secs(5);

/// Time within which a working program would have sent or read again.
const NEXT: Duration = Duration::from_secs(1);

/// A fault that was active shortly before a failure.
pub(super) struct Trigger<'a> {
    fault: &'a FaultSpec,
    at: Instant,
}

impl<'a> Trigger<'a> {
    /// The fault with the last begin before `at`, if it was still active shortly before `at`.
    pub(super) fn before(evidence: &'a Evidence<'_>, at: Instant) -> Option<Self> {
        Self::before_on(evidence, at, |_| true)
    }

    /// The same for a program that sent or read last at `at`: the fault may have begun shortly
    /// after that.
    pub(super) fn of_silence(evidence: &'a Evidence<'_>, at: Instant) -> Option<Self> {
        Self::before(evidence, at + NEXT)
    }

    /// The same for a program that waits at the port of `device`: a fault there, otherwise another.
    pub(super) fn of_silence_at(
        evidence: &'a Evidence<'_>,
        at: Instant,
        device: &str,
    ) -> Option<Self> {
        Self::before_on(evidence, at + NEXT, |fault| fault.is_at(device))
            .or_else(|| Self::of_silence(evidence, at))
    }

    /// The same, limited to faults that change the bytes of `device` or their times.
    pub(super) fn from_device(
        evidence: &'a Evidence<'_>,
        at: Instant,
        device: &str,
    ) -> Option<Self> {
        Self::before_on(evidence, at, |fault| {
            fault.is_at(device) && (is_both_ways(fault) || !is_towards_device(fault))
        })
    }

    /// The fault that damaged bytes for the program just before `at`, on any link: it may have
    /// passed their values on.
    pub(super) fn of_values(evidence: &'a Evidence<'_>, at: Instant) -> Option<Self> {
        let damages = |fault: &FaultSpec| fault.byte.is_some() && !is_towards_device(fault);
        let found = Self::before_on(evidence, at, damages);
        found.filter(|one| at - one.at.min(at) <= NEXT)
    }

    /// The same for faults that keep bytes from `device`, or change them.
    pub(super) fn to_device(evidence: &'a Evidence<'_>, at: Instant, device: &str) -> Option<Self> {
        Self::before_on(evidence, at, |fault| {
            let is_to_master = fault.direction == Some(DirectionSpec::ToMaster);
            fault.is_at(device) && (is_both_ways(fault) || !is_to_master)
        })
    }

    /// The fault that was active shortly before `begins`, or else the last one that began until
    /// `ends`, or else one that was active from the start until then.
    pub(super) fn around(
        evidence: &'a Evidence<'_>,
        begins: Instant,
        ends: Instant,
    ) -> Option<Self> {
        Self::before(evidence, begins)
            .or_else(|| Self::before(evidence, ends))
            .or_else(|| Self::from_the_start(evidence, begins))
    }

    fn from_the_start(evidence: &'a Evidence<'_>, at: Instant) -> Option<Self> {
        let mut faults = evidence.outcome.case.fault.iter();
        let fault = faults.find(|fault| {
            let ends = fault.window().until;
            let is_first =
                fault.byte.is_none() && !waits(fault) && fault.window().from == Instant::ZERO;
            is_first && at - ends.min(at) <= SOON
        })?;
        let at = Instant::ZERO;
        Some(Self { fault, at })
    }

    /// Whether the fault damages bytes that the program receives, or their times.
    fn is_of_input(&self) -> bool {
        self.fault.direction != Some(DirectionSpec::ToDevice)
    }

    fn before_on(
        evidence: &'a Evidence<'_>,
        at: Instant,
        is_of_it: impl Fn(&FaultSpec) -> bool,
    ) -> Option<Self> {
        let faults = evidence.outcome.case.fault.iter();
        let begun = faults.filter(|fault| is_of_it(fault)).filter_map(|fault| {
            let begun = begin(evidence, fault)?;
            let ends = match fault.byte {
                Some(_) => begun,
                None => fault.window().until,
            };
            (begun <= at && at - ends.min(at) <= SOON).then_some(Self { fault, at: begun })
        });
        begun.max_by_key(|one| one.at)
    }

    /// The trigger as the end of a sentence about `then`: `, after flip on grip at 0.200000 s`.
    pub(super) fn words(&self, then: Instant) -> String {
        let (kind, place, at) = (self.fault.kind.name(), self.fault.place(), self.at);
        if at == Instant::ZERO && self.fault.byte.is_none() {
            return format!(", with {kind} on {place} from the start");
        }
        let order = match at <= then {
            true => "after",
            false => "then came",
        };
        let byte = self.fault.byte.map_or_else(String::new, |byte| {
            let way = match self.fault.direction {
                Some(DirectionSpec::ToDevice) => "to-device",
                _ => "to-master",
            };
            format!(" (byte {byte} {way})")
        });
        format!(", {order} {kind} on {place}{byte} at {at} s")
    }

    /// A fix in the program for such a fault.
    pub(super) const fn remedy(&self) -> Option<&'static str> {
        use FaultKind::{
            Burst, Clog, Delayed, Drop, Duplicate, Flip, Insert, Jitter, Latency, Stall, Swap,
            Truncate,
        };
        match self.fault.kind {
            Flip | Drop | Insert | Duplicate | Burst | Truncate | Swap => Some(
                "it takes a damaged frame for a sound one, or does not find the next frame: verify \
                 checksum and length, and search the next header from the byte behind the bad one",
            ),
            Delayed | Latency | Jitter | Stall | Clog => Some(
                "it takes a late reply for the reply to a later request: discard the received \
                 bytes before each request, or compare the reply with the request",
            ),
            _ => None,
        }
    }
}

fn is_towards_device(fault: &FaultSpec) -> bool {
    fault.direction == Some(DirectionSpec::ToDevice)
}

/// Whether the fault acts on both directions, whichever the scenario names.
fn is_both_ways(fault: &FaultSpec) -> bool {
    fault.kind == FaultKind::Unplugged
}

/// The fault around an effect from `begins` to `ends`, as the end of a sentence, with the fix.
pub(super) fn around(evidence: &Evidence<'_>, [begins, ends]: [Instant; 2]) -> String {
    let Some(trigger) = Trigger::around(evidence, begins, ends) else {
        return String::new();
    };
    let remedy = trigger.remedy().filter(|_| trigger.is_of_input());
    let remedy = remedy.and_then(|remedy| remedy.strip_prefix("it "));
    let remedy = remedy.map_or_else(String::new, |remedy| {
        format!("; perhaps the program {remedy}")
    });
    trigger.words(begins) + &remedy
}

/// Whether an event at `at` can explain a failed check: it comes shortly before the failure. A
/// check without a time judges the whole run.
pub(super) fn explains(outcome: &Outcome, at: Instant) -> bool {
    let mut failed = outcome.checks.iter();
    failed.any(|check| {
        check.status == Status::Fail
            && failed_at(check).is_none_or(|failed| at <= failed && failed - at <= SOON)
    })
}

/// A rule of the scenario that is broken just after bytes for the program were damaged: it may have
/// used their values.
pub(super) fn rules(evidence: &Evidence<'_>) -> Option<Cause> {
    let checks = evidence.outcome.checks.iter();
    let mut failed = checks.filter(|check| check.status == Status::Fail);
    failed.find_map(|check| {
        let name = check.name.strip_prefix("rule-")?;
        let at = failed_at(check)?;
        let trigger = Trigger::of_values(evidence, at)?;
        let remedy = trigger.remedy()?.strip_prefix("it ")?;
        let words = trigger.words(at);
        let text =
            format!("the rule {name} is broken at {at} s{words}; perhaps the program {remedy}");
        Some(Cause::new(weight::FAULTED, text))
    })
}

/// The first time in the words of a check: `still moving at 5.37 s, ..`.
fn failed_at(check: &Check) -> Option<Instant> {
    let mut words = check.detail.split(' ').peekable();
    while let Some(word) = words.next() {
        let seconds = match word {
            "at" | "since" => words.peek().and_then(|next| next.parse::<f64>().ok()),
            _ => None,
        };
        if let Some(seconds) = seconds.filter(|seconds| (0.0..1e9).contains(seconds)) {
            return Some(Instant::ZERO + Duration::from_secs_f64(seconds));
        }
    }
    None
}

/// Maximum number of parts in the words about faults.
const NAMED_MAX: usize = 6;

/// The faults that took effect during the run, in words: struck bytes by link and kind, then the
/// others with their start. `None` without such a fault.
pub(super) fn all_in_words(evidence: &Evidence<'_>) -> Option<String> {
    let ran = Instant::ZERO + evidence.outcome.ran;
    let mut struck: BTreeMap<(String, &str), u64> = BTreeMap::new();
    let mut others = Vec::new();
    for fault in &evidence.outcome.case.fault {
        let (kind, place) = (fault.kind.name(), fault.place());
        let from = fault.window().from;
        match fault.byte {
            Some(_) if evidence.outcome.struck_at(fault).is_some() => {
                // A truncated frame is counted as the byte at which it ends: its rest is not known.
                let bytes = match fault.kind {
                    FaultKind::Burst => fault.len.unwrap_or(1),
                    _ => 1,
                };
                *struck.entry((place, kind)).or_default() += u64::from(bytes);
            }
            None if !waits(fault) && from < ran => {
                others.push(format!("{kind} on {place} from {from} s"));
            }
            _ => {}
        }
    }
    let struck = struck.iter();
    let struck = struck.map(|((link, kind), bytes)| format!("{kind} of {bytes} B on {link}"));
    let mut all: Vec<String> = struck.chain(others).collect();
    let more = all.len().saturating_sub(NAMED_MAX);
    all.truncate(NAMED_MAX);
    let more = match more {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    (!all.is_empty()).then(|| all.join(", ") + &more)
}

/// Whether `fault` waits for a byte, a frame or a condition, so that its start is unknown.
fn waits(fault: &FaultSpec) -> bool {
    fault.at_byte.is_some() || fault.at_frame.is_some() || fault.waits_for_condition()
}

/// The fault before `at`, as the end of a sentence.
pub(super) fn after(evidence: &Evidence<'_>, at: Instant) -> String {
    Trigger::before(evidence, at).map_or_else(String::new, |trigger| trigger.words(at))
}

/// Start of `fault`; `None` if it has not begun, or if the start is unknown.
fn begin(evidence: &Evidence<'_>, fault: &FaultSpec) -> Option<Instant> {
    if fault.byte.is_none() {
        let is_unknown = waits(fault);
        // A fault that is active from the start is no event.
        return fault
            .from
            .filter(|from| !is_unknown && !from.0.is_zero())
            .map(|from| Instant::ZERO + from.0);
    }
    evidence.outcome.struck_at(fault)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::Sign;
    use crate::exec::ports::Ports;
    use crate::transport::Special;
    use emulators::world::Pose;
    use engine::rig::fault::{Damage, Strike};
    use engine::run::check::Check;
    use engine::run::{Outcome, Run};
    use engine::scenario::Scenario;

    /// A robot of data with the link `drive`, after a short run.
    fn outcome(faults: &str) -> Outcome {
        let text = format!(
            "schema = 1\nname = \"own\"\nrobot = \"custom\"\nduration = \"20s\"\n\
             mission.waypoints_m = [[2.0, 1.0]]\nchassis.differential = {{}}\n\
             world.start = {{ x_m = 1.0, y_m = 1.0, heading_deg = 0 }}\n\
             world.wall = [{{ path_m = [[0, 0], [3, 0], [3, 2], [0, 2], [0, 0]] }}]\n\
             [device.drive.text]\nbaud = 9600\n\
             [[device.drive.text.command]]\nrequest = \"ping\"\nreply = \"pong\"\n{faults}"
        );
        let (mut scenario, source) = Scenario::from_text(&text).expect("sound");
        let fault = core::mem::take(&mut scenario.fault);
        let run = Run::new(scenario, &source, None).expect("it can be wired");
        let mut outcome = run.judge_what_is_expected();
        outcome.ran = Duration::from_secs(20);
        outcome.strikes = fault.iter().filter_map(strike).collect();
        outcome.case.fault = fault;
        outcome.checks.clear();
        outcome
    }

    /// 100 bytes pass in each of the 20 seconds.
    fn strike(fault: &FaultSpec) -> Option<(String, DirectionSpec, Strike, Instant)> {
        let byte = fault.byte.filter(|byte| *byte < 2_000)?;
        let damage = Damage::Drop;
        let at = Instant::from_secs(byte / 100);
        Some((
            fault.link.clone()?,
            fault.direction?,
            Strike { byte, damage },
            at,
        ))
    }

    fn passed(all: u64) -> Special {
        Special {
            all,
            ..Special::default()
        }
    }

    /// 100 bytes of each direction passed in each second.
    fn ports() -> Ports {
        let mut ports = Ports::default();
        ports.add("drive", PathBuf::new(), true);
        for second in 1..=20 {
            let sign = Sign {
                name: "drive",
                is_open: true,
                openings: 1,
                from_client: second * 100,
                to_client: second * 100,
                lost: Default::default(),
                special: [passed(second * 100); 2],
                wrong_rate: None,
                garbled: Default::default(),
                settings: None,
                is_drained: true,
                reads: Some(second),
            };
            let now = Instant::from_secs(second);
            ports.observe(now, Duration::from_secs(1), &sign);
        }
        ports
    }

    fn cause(mut outcome: Outcome, failed: &str) -> String {
        outcome.checks.push(Check::new(failed, false, "no"));
        let evidence = Evidence {
            ports: &ports(),
            waits: &[],
            ended: None,
            said: "",
            outcome: &outcome,
        };
        super::super::probable(&evidence).expect("it failed")
    }

    const FLIP: &str = "[[fault]]\nlink = \"drive\"\ndirection = \"to-master\"\n\
        kind = \"flip\"\nbyte = 650\nbit = 1\n";
    const DROP: &str = "[[fault]]\nlink = \"drive\"\ndirection = \"to-device\"\n\
        kind = \"drop\"\nbyte = 650\n";
    const CUT: &str = "[[fault]]\nlink = \"drive\"\ndirection = \"to-master\"\n\
        kind = \"cut\"\nfrom = \"6s\"\n";
    const WRONG: &str = "[[fault]]\nlink = \"drive\"\ndirection = \"to-master\"\n\
        kind = \"latency\"\nby = \"90ms\"\n";

    /// The path of a robot that stands from 8 s on; turns by 229 degrees for no reason before that,
    /// if it `turns`.
    fn path(turns: bool) -> Vec<(Instant, Pose)> {
        let pose = |tenth: u64| {
            let at = Instant::from_millis(tenth * 100);
            let done = tenth.min(80) as f64 / 80.0;
            let theta = match turns {
                true => (tenth.clamp(75, 85) - 75) as f64 * 0.4,
                false => 0.0,
            };
            let x = 1.0 + 0.3 * done;
            (at, Pose { x, y: 1.0, theta })
        };
        (0..200).map(pose).collect()
    }

    /// A flip at 6 s, and motion that goes wrong at 7.5 s or 8 s: the line names the fault. Without
    /// a fault, and with one that is long over or comes later, it names none.
    #[test]
    fn wrong_motion_names_the_fault_before_it() {
        let after = ", after flip on drive (byte 650 to-master) at 6.000000 s; perhaps the program \
                     takes a damaged frame for a sound one";
        let early = FLIP.replace("650", "110");
        let late = FLIP.replace("650", "1500");
        for (turns, effect) in [(true, "turned too far"), (false, "does not drive it")] {
            let moved = |faults: &str| {
                let mut outcome = outcome(faults);
                outcome.truth = path(turns);
                outcome.waypoints = [0, 1];
                let said = cause(outcome, "waypoints-visited");
                assert!(said.contains(effect), "{said}");
                said
            };
            assert!(moved(FLIP).contains(after), "{}", moved(FLIP));
            let dropped = moved(DROP);
            assert!(dropped.ends_with("after drop on drive (byte 650 to-device) at 6.000000 s"));
            assert!(moved(CUT).ends_with(", after cut on drive at 6.000000 s"));
            assert!(moved(WRONG).contains(", with latency on drive from the start"));
            for none in ["", &early, &late] {
                assert!(!moved(none).contains(" on drive"), "{}", moved(none));
            }
        }
        let mut hit = outcome(FLIP);
        hit.collided_at = Some(Instant::from_secs(7));
        hit.waypoints = [1, 1];
        let said = cause(hit, "no-collision-at-speed");
        assert!(
            said.contains("drove into something") && said.contains(after),
            "{said}"
        );
        // The turn from 7.5 s on and the stop at 8 s come after a collision at 7 s, and before one
        // at 9 s.
        for (turns, effect) in [(true, "turned too far"), (false, "does not drive it")] {
            for (second, cause_of_it) in [(7, "drove into something"), (9, effect)] {
                let mut outcome = outcome("");
                outcome.truth = path(turns);
                outcome.waypoints = [0, 1];
                outcome.collided_at = Some(Instant::from_secs(second));
                let said = cause(outcome, "no-collision-at-speed");
                assert!(said.contains(cause_of_it), "{second}: {said}");
            }
        }
    }

    /// A program waits for a reply on one link, while a later fault begins on another one.
    #[test]
    fn a_fault_on_the_port_itself_is_named_before_one_elsewhere() {
        let other = "[[fault]]\nlink = \"eye\"\ndirection = \"to-master\"\nkind = \"cut\"\n\
                     from = \"6.5s\"\n";
        let at = Instant::from_secs(6);
        for (faults, link) in [
            (format!("{FLIP}{other}"), "drive"),
            (other.to_owned(), "eye"),
        ] {
            let outcome = outcome(&faults);
            let evidence = Evidence {
                ports: &ports(),
                waits: &[],
                ended: None,
                said: "",
                outcome: &outcome,
            };
            let trigger = Trigger::of_silence_at(&evidence, at, "drive").expect("a fault");
            let words = trigger.words(at);
            assert!(words.contains(&format!(" on {link} ")), "{words}");
        }
    }

    /// A watchdog that fires at 5 s explains a failure at 8 s, not one at 12 s nor an earlier one;
    /// a check without a time judges the whole run. A fault acts on a device by its name or that of
    /// its link, not by the start of another name.
    #[test]
    fn a_cause_is_near_its_effect_in_time_and_place() {
        let at = Instant::from_secs(5);
        for (detail, explained) in [
            (
                "still moving at 8.5 s, 1 s after the last byte of eye",
                true,
            ),
            (
                "3 contacts, the first harmful one at 12.333 s, the fastest at 0.3 m/s",
                false,
            ),
            ("still moving at 4.2 s", false),
            ("1 of 3 waypoints", true),
            ("at least 2 of 3", true),
        ] {
            let mut outcome = outcome("");
            outcome.checks.push(Check::new("sound", true, "at 6 s"));
            outcome.checks.push(Check::new("failed", false, detail));
            assert_eq!(explains(&outcome, at), explained, "{detail}");
        }
        let fault = outcome(CUT).case.fault.remove(0);
        let places = ["drive", "driver", "driv", "drive-2", ""].map(|name| {
            let mut fault = fault.clone();
            fault.link = Some(name.to_owned());
            fault.is_at("drive")
        });
        assert_eq!(places, [true, false, false, true, false]);
    }

    /// Frames are not as they should be if faults struck them. A byte that did not pass was not
    /// struck.
    #[test]
    fn an_unknown_cause_lists_the_faults() {
        let sound = cause(outcome(""), "rule-answers");
        assert!(
            sound.contains("line settings, rates and frames are as"),
            "{sound}"
        );
        let more = FLIP.replace("650", "651");
        let never = FLIP.replace("650", "9999");
        let said = cause(
            outcome(&[FLIP, &more, &never, DROP, CUT].concat()),
            "rule-answers",
        );
        let expected = "drop of 1 B on drive, flip of 2 B on drive, cut on drive from 6.000000 s";
        assert!(said.contains(expected), "{said}");
        assert!(!said.contains("frames"), "{said}");
    }
}
