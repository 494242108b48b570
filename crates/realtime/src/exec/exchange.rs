//! Whether a program continues to work: it sends and reads, and does not fall silent.
//!
//! A program that waits forever breaks no rule of a device and does not end, so no other check
//! would fail. Only rig time counts. A program that listens to a silent device is not silent
//! itself.

use core::time::Duration;

use protocols::Instant;

use super::ports::{Port, Ports};
use crate::garbled::Rates;
use crate::transport::{Setting, Special};
use engine::run::check::{
    Check, GOES_ON, PAUSES_MAX, SILENT_MAX, STREAM, is_done, is_misunderstood, unheard,
};
use engine::scenario::{FaultKind, FaultSpec};

/// Options that allow silence.
pub(super) const ALLOW_IT: &str = "allow it with --exec-may-idle (firmware: --firmware-may-idle; in a file: may_idle of its exec table)";

/// Minimum number of times that a program sends, and minimum time from the first to the last one,
/// if it sends regularly.
const SENT_MIN: usize = 5;
const SENT_FOR: Duration = Duration::from_secs(1);
/// Time before a fault's effect within which the program sent the request that it strikes.
const BEFORE: Duration = Duration::from_millis(100);
/// Time within which a device replies.
const REPLY: Duration = Duration::from_secs(1);

/// Observations of the run besides the ports.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rest<'a> {
    /// Rig time at the end.
    pub now: Instant,
    /// Whether the program ended by itself.
    pub has_ended: bool,
    /// Whether the operator ended the run early.
    pub is_cut: bool,
    /// Whether the program printed nothing and did not end with exit code 0.
    pub is_mute: bool,
    /// Whether the user allows the program to fall silent.
    pub may_idle: bool,
    /// Whether another check about the ports has already failed.
    pub is_told: bool,
    /// The other checks of the run.
    pub checks: &'a [Check],
    /// Whether a device received a byte.
    pub was_heard: bool,
    /// Number of broken rules that mean that a device does not understand its input.
    pub misunderstood: u64,
    /// Requests that no device can answer, see [`astray`](engine::run::check::astray).
    pub astray: Option<&'a str>,
    /// The faults of the run, each struck byte as one of its own.
    pub faults: &'a [FaultSpec],
}

impl Ports {
    /// The verdict on a program's sending and reading.
    pub(crate) fn go_on(&self, rest: &Rest<'_>) -> Check {
        let seen: Vec<&Port> = self.all.iter().filter(|port| port.was_opened).collect();
        if seen.iter().all(|port| port.reads.is_none()) {
            return Check::not_observed(GOES_ON, "no port was opened at which reads can be seen");
        }
        if rest.is_cut {
            return Check::not_observed(GOES_ON, "the run was ended before its time");
        }
        if rest.is_told {
            return Check::not_observed(GOES_ON, "its ports failed already, see the check before");
        }
        let sent: u64 = seen.iter().map(|port| port.from_client).sum();
        let brought: u64 = seen.iter().map(|port| port.to_client).sum();
        let has_read = seen.iter().any(|port| port.read_at.is_some());
        let passed = format!("sent {sent} B, {brought} B arrived for it");
        let may_rest = rest.may_idle || is_done(rest.checks);
        let fail = |detail: String| Check::new(GOES_ON, false, detail);
        if sent == 0 && !has_read {
            return fail(match brought {
                0 => "no byte passed in either direction: nothing was observed".to_owned(),
                _ => format!("it sent nothing and read nothing; {brought} B arrived for it"),
            });
        }
        if sent > 0
            && brought == 0
            && !rest.was_heard
            && let Some(why) = unheard(rest.checks)
        {
            return fail(format!("{passed}; {why}"));
        }
        if sent == 0 && rest.is_mute && !may_rest {
            return fail(format!(
                "{passed}; it sent nothing and printed nothing: its use of the bytes was not \
                 observed; let it print its readings, or {ALLOW_IT}"
            ));
        }
        let mut wrong = seen.iter().filter(|port| port.is_mostly_wrong());
        if let Some((port, (own, far))) = wrong.find_map(|port| Some((port, port.rates()?))) {
            let name = &port.name;
            return fail(format!(
                "{name}: client at {own} baud, expected {far}: both sides read garbage"
            ));
        }
        let times = rest.misunderstood;
        if is_misunderstood(times, sent, brought) {
            return fail(format!(
                "{passed}: {times} times a device did not understand it, or refused it"
            ));
        }
        if let Some(astray) = rest.astray {
            return fail(format!("{passed}: {astray}"));
        }
        if let (Some(port), false) = (
            self.stalled(rest.now, rest.faults),
            rest.has_ended || may_rest,
        ) {
            let (name, at) = (&port.name, port.sent_at.unwrap_or_default());
            let seconds = (rest.now - at).as_secs_f64();
            return fail(match port.is_open {
                true => format!(
                    "{passed}; it sent regularly on {name} until a fault at {at} s, and nothing in \
                     the {seconds:.1} s since then; {ALLOW_IT}"
                ),
                false => format!(
                    "{passed}; it sent regularly on {name} until {at} s; then the port was unplugged and \
                     came back, and it did not open it again; {ALLOW_IT}"
                ),
            });
        }
        let Some(silent_for) = self.silent_for(rest.now).filter(|_| !rest.has_ended) else {
            return Check::new(GOES_ON, true, passed);
        };
        let limit = SILENT_MAX.max(self.longest_pause * PAUSES_MAX);
        let since = self.active_at.unwrap_or_default();
        let seconds = silent_for.as_secs_f64();
        let detail = format!("{passed}; the last of it at {since} s, silent for {seconds:.1} s");
        if silent_for <= limit || may_rest {
            return Check::new(GOES_ON, true, detail);
        }
        fail(format!("{detail}; {ALLOW_IT}"))
    }

    /// A port on which the program sent regularly, and nothing more since a fault struck its last
    /// request or the reply. It may still read: a device can send without requests. A port that was
    /// unplugged and came back is not open any more.
    pub(super) fn stalled(&self, now: Instant, faults: &[FaultSpec]) -> Option<&Port> {
        let is_back = |port: &Port| {
            let pulled = |fault: &FaultSpec| {
                fault.kind == FaultKind::Unplugged
                    && fault.is_at(&port.name)
                    && fault.window().until < now
            };
            port.was_opened && faults.iter().any(pulled)
        };
        let watched = self.all.iter();
        let mut watched = watched.filter(|port| port.is_open || is_back(port));
        watched.find(|port| {
            let Some(Regular {
                first,
                last,
                longest,
            }) = port.regular()
            else {
                return false;
            };
            let is_silent = now - last > SILENT_MAX.max(longest * PAUSES_MAX);
            let strikes = |fault: &FaultSpec| {
                let (begin, end) = match fault.byte {
                    Some(_) => {
                        let at = port.struck_at(fault, faults);
                        (at, at)
                    }
                    None => {
                        let window = fault.window();
                        (Some(window.from), Some(window.until))
                    }
                };
                fault.is_at(&port.name)
                    && begin.is_some_and(|begin| first < begin && begin <= last + REPLY)
                    && end.is_some_and(|end| end + BEFORE >= last)
            };
            is_silent && faults.iter().any(strikes)
        })
    }

    /// Time during which the program neither sent nor read although a device had bytes for it or
    /// waited for a request. `None` if the program only listens to devices that are silent
    /// themselves, and sends regularly to no other.
    fn silent_for(&self, now: Instant) -> Option<Duration> {
        let active = self.active_at?;
        let open = || self.all.iter().filter(|port| port.is_open);
        // A device that sends long after its last request and then stops also stops a sound
        // listener.
        let is_stream = |port: &Port| {
            let sent = port.sent_at.unwrap_or_default();
            port.heard_at.is_some_and(|heard| heard > sent + STREAM)
                && port.read_at >= port.heard_at
        };
        let may_listen = open().any(is_stream) && !open().any(|port| port.regular().is_some());
        (!may_listen).then(|| now - active)
    }
}

impl Ports {
    /// The line settings of clients that changed bytes. They are no failure by themselves: a
    /// program that reads whole lines may need them.
    pub(crate) fn settings(&self) -> Check {
        let opened = self.all.iter().filter(|port| port.was_opened);
        let acted: Vec<String> = opened.filter_map(Port::acted).collect();
        let detail = match acted.is_empty() {
            true => "no line setting of the program changed a byte".to_owned(),
            false => acted.join("; "),
        };
        let is_seen = self.all.iter().any(|port| port.was_opened);
        Check::new("port-settings", true, detail).if_observed(is_seen)
    }
}

/// The times at which a program sends regularly.
struct Regular {
    first: Instant,
    last: Instant,
    /// The longest pause between two of them.
    longest: Duration,
}

impl Port {
    /// The times at which the program has sent, if they are regular.
    fn regular(&self) -> Option<Regular> {
        let sent = self.sent();
        let ([first, .., last], true) = (sent.as_slice(), sent.len() >= SENT_MIN) else {
            return None;
        };
        let pauses = sent.windows(2).map(|pair| pair[1] - pair[0]);
        let longest = pauses.max().unwrap_or_default();
        let (first, last) = (*first, *last);
        let regular = Regular {
            first,
            last,
            longest,
        };
        (last - first >= SENT_FOR.max(longest * 4)).then_some(regular)
    }

    /// Settings that changed the client's bytes, for the user.
    pub(super) fn acted(&self) -> Option<String> {
        self.acted_of(|_| true)
    }

    /// The same, without the parity bit, which changes no byte.
    pub(super) fn changed(&self) -> Option<String> {
        self.acted_of(|setting| setting != Setting::Parity)
    }

    fn acted_of(&self, counts: fn(Setting) -> bool) -> Option<String> {
        let [to, from] = self.special;
        let effect = |setting: Setting| {
            let what = effect(setting, to, from)?;
            Some(format!("{} {what}", setting.name()))
        };
        let settings = self.settings.all().filter(|setting| counts(*setting));
        let acted: Vec<String> = settings.filter_map(effect).collect();
        (!acted.is_empty()).then(|| format!("{}: {}", self.name, acted.join(", ")))
    }

    /// Rates of client and device that did not understand each other.
    pub(super) fn rates(&self) -> Option<Rates> {
        let garbled = self.garbled.since.map(|(rates, _)| rates);
        garbled.or_else(|| self.was_wrong.map(|(own, far, _)| (own, far)))
    }

    /// Whether the client used a wrong rate for most of the time that the port was open, and still
    /// does, or the last bytes passed at a wrong one after others at the right one.
    fn is_mostly_wrong(&self) -> bool {
        let [open, wrong] = self.open_for;
        let has_passed = self.from_client + self.to_client > 0;
        let is_forgotten = self.garbled.since.is_some() && self.garbled.is_last();
        has_passed && (is_forgotten || self.wrong_rate.is_some() && wrong * 2 > open)
    }
}

/// Effect of a setting on the bytes that passed; `None` without an effect.
fn effect(setting: Setting, to: Special, from: Special) -> Option<String> {
    let brought = to.all;
    let some = |count: u64, text: String| (count > 0).then_some(text);
    match setting {
        // In virtual time, bytes that wait for the end of their line have not arrived yet.
        Setting::Canonical => (brought > 0).then(|| {
            let lines = match to.lf {
                0 => "none came".to_owned(),
                lf => format!("{lf} of {brought} B were that"),
            };
            format!("(canonical mode) lets a read end at 0x0A only, and {lines}")
        }),
        Setting::Echo => some(
            brought,
            format!("sends what the device says back to it: {brought} B"),
        ),
        Setting::XonXoff => some(
            to.flow,
            format!(
                "takes 0x11 and 0x13 out of what the device sends: {} of them",
                to.flow
            ),
        ),
        Setting::Strip => some(
            to.high,
            format!("cuts the highest bit (7 bits are left): of {} B", to.high),
        ),
        Setting::FewBits => some(
            to.cut,
            format!(
                "cuts characters to fewer than 8 bits in both directions: {} B; set CS8",
                to.cut
            ),
        ),
        Setting::Parity => some(
            brought + from.all,
            "adds a parity bit, which this port does not check; the device must have it, too"
                .to_owned(),
        ),
        Setting::CrToLf => some(to.cr, format!("makes 0x0A of 0x0D: {} times", to.cr)),
        Setting::LfToCr => some(to.lf, format!("makes 0x0D of 0x0A: {} times", to.lf)),
        Setting::IgnoreCr => some(to.cr, format!("removes 0x0D: {} times", to.cr)),
        Setting::Signals => some(
            to.signals,
            format!(
                "takes 0x03, 0x1A and 0x1C for signals: {} of them",
                to.signals
            ),
        ),
        Setting::LfToCrLf => some(
            from.lf,
            format!("sends 0x0D 0x0A instead of 0x0A: {} times", from.lf),
        ),
        Setting::CrSentAsLf => some(
            from.lf,
            format!("sends 0x0A instead of 0x0D: up to {} times", from.lf),
        ),
        Setting::MayReadNothing => None,
    }
}
