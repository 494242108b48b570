//! Causes at a port: its rate, its settings, whether the program opens and reads it.

use core::time::Duration;
use std::path::Path;

use protocols::Instant;

use super::trigger::Trigger;
use super::{Cause, Evidence, MANY, weight};
use crate::exec::exchange::ALLOW_IT;
use crate::exec::ports::Port;
use crate::process::waits::Wait;
use crate::transport::Setting;
use engine::run::OwnBreaks;
use engine::run::check::{GOES_ON, SILENT_MAX, Status, last_words};

/// Minimum time from broken rules to a hang that they explain.
const SOON: Duration = Duration::from_secs(1);
/// Name of the check that all lines carry bytes again.
const BACK: &str = "at-work-again";

pub(super) fn causes(evidence: &Evidence<'_>) -> Vec<Cause> {
    let mut causes = Vec::new();
    for port in &evidence.ports.all {
        causes.extend(rate(port, evidence));
        causes.extend(setting(port));
        causes.extend(unread(port, evidence));
        causes.extend(lost(port));
    }
    causes.extend(not_opened(evidence));
    causes.extend(held_up(evidence));
    causes.extend(silent(evidence));
    causes.extend(not_back(evidence));
    causes.extend(stalled(evidence));
    causes
}

/// A client with another rate than its device, or than its cable to another program.
fn rate(port: &Port, evidence: &Evidence<'_>) -> Option<Cause> {
    let since = port.garbled.since.filter(|_| port.garbled.is_forgotten());
    if let Some(((own, far), at)) = since {
        let name = &port.name;
        return Some(Cause::new(
            weight::RATE,
            format!(
                "wrong baud rate: bytes pass port {name} at {at} s while its client is at {own} \
                 baud and its device at {far}, after bytes at the right rate; one of them has \
                 changed its rate: change the client's together with the device's"
            ),
        ));
    }
    let (own, other, at) = port.was_wrong?;
    let mut cables = evidence.outcome.case.cable.values();
    let cable = cables.find(|cable| [&cable.master, &cable.device].contains(&&port.name));
    let (far, whose) = match cable {
        // The other program has the wrong rate.
        Some(cable) if cable.baud == own => return None,
        Some(cable) => (cable.baud, "cable has"),
        None => (other, "device expected"),
    };
    let [open, wrong] = port.open_for;
    // A client that tries several rates and ends at the right one has found it.
    if port.wrong_rate.is_none() && wrong * 2 <= open {
        return None;
    }
    let name = &port.name;
    Some(Cause::new(
        weight::RATE,
        format!(
            "wrong baud rate: the client of port {name} is at {own} baud since {at} s, its {whose} \
             {far}; open the port at {far} baud"
        ),
    ))
}

/// Line settings that changed bytes or held them back.
fn setting(port: &Port) -> Option<Cause> {
    let acted = port.changed()?;
    Some(Cause::new(
        weight::SETTING,
        format!(
            "line settings: the client's port is not raw: {acted}; set it raw (cfmakeraw, \
             tty.setraw, stty raw -echo)"
        ),
    ))
}

/// A port whose bytes are never read.
fn unread(port: &Port, evidence: &Evidence<'_>) -> Option<Cause> {
    let at = port.hangs_at?;
    let (name, brought) = (&port.name, port.special[0].all);
    let waits = what_for(evidence);
    let text = match port.read_at {
        None => format!(
            "port {name} was opened, and none of the {brought} B that arrived for it was read{waits}; \
             read it in a separate thread, or in the main loop"
        ),
        Some(read) => format!(
            "the program stopped reading port {name} at {read} s; bytes waited for 2 s by {at} \
             s{waits}"
        ),
    };
    // Rules that were broken many times before it explain why it stopped.
    let broken = evidence.outcome.own_breaks.iter();
    let mut broken = broken.filter(|broken| broken.count >= MANY && broken.device == *name);
    let is_explained = |broken: &OwnBreaks| {
        let first = broken.first.as_ref();
        first.is_some_and(|(first, _)| *first + SOON < port.read_at.unwrap_or(at))
    };
    let weight = match broken.any(is_explained) {
        true => weight::MOTORS,
        false => weight::UNREAD,
    };
    Some(Cause::new(weight, text))
}

/// A port that is not read because the program is blocked at another one.
fn held_up(evidence: &Evidence<'_>) -> Option<Cause> {
    let all = &evidence.ports.all;
    let unread = |port: &&Port| port.hangs_at.is_some();
    let hangs = all.iter().find(unread)?;
    let blocked = evidence.waits.iter().find_map(|wait| match wait {
        Wait::Read(path) => {
            let port = all.iter().find(|port| port.path == *path)?;
            let is_held = port.hangs_at.is_none() && has_no_timeout(port);
            is_held.then(|| format!("a read of port {}", port.name))
        }
        // Bytes wait at the unread ports, so the call does not wait for them.
        Wait::Any { for_ever: true } => {
            let others = evidence
                .ports
                .names(|port| port.is_open && port.hangs_at.is_none());
            (!others.is_empty()).then(|| format!("a poll or select of port {others}"))
        }
        _ => None,
    })?;
    let at = evidence.ports.active_at.unwrap_or_default();
    let trigger = Trigger::of_silence(evidence, at);
    let after = trigger.map_or_else(String::new, |trigger| trigger.words(at));
    let name = &hangs.name;
    Some(Cause::new(
        weight::HELD_UP,
        format!(
            "blocked in {blocked} without a timeout; give it a timeout and ask again (the last it \
             sent or read was at {at} s{after}); meanwhile it does not read port {name}"
        ),
    ))
}

/// Whether a read of the port waits forever.
fn has_no_timeout(port: &Port) -> bool {
    !port.settings_now.has(Setting::MayReadNothing)
}

/// The call in which the program waited at the end, as the end of a sentence.
pub(super) fn what_for(evidence: &Evidence<'_>) -> String {
    let is_port = |path: &Path| evidence.ports.all.iter().any(|port| port.path == path);
    let text = evidence.waits.iter().find_map(|wait| match wait {
        Wait::ModemLine(_) => Some("it waits for a modem line to change"),
        Wait::Write(_) => Some("it waits in a write"),
        Wait::Drain(_) => Some("it waits in tcdrain"),
        Wait::Sleep => Some("it sleeps"),
        Wait::Lock => Some("it waits for a lock or another thread"),
        Wait::Read(path) if !is_port(path) => Some(match path.to_string_lossy() {
            path if path.starts_with("pipe:") => "it waits in a read of a pipe",
            path if path.starts_with("socket:") => "it waits for a socket",
            _ => "it waits in a read of another file",
        }),
        Wait::Read(_) | Wait::Any { .. } => None,
    });
    let text = text.map_or_else(String::new, |text| format!(" ({text} in the end)"));
    let last = last_words(evidence.said);
    // An error that ended a thread but not the program.
    let is_error = |line: &&str| {
        let words = ["Error", "Exception", "panicked", "error"];
        words.iter().any(|word| line.contains(word))
    };
    match last.filter(is_error) {
        Some(line) => format!("{text}; its last words: {line}"),
        None => text,
    }
}

/// Bytes that were lost because the client reads too seldom.
fn lost(port: &Port) -> Option<Cause> {
    let (name, lost) = (&port.name, port.lost.overrun);
    (lost > 0).then(|| {
        Cause::new(
            weight::LOST,
            format!(
                "{lost} B were lost at port {name}, because the program did not read them in \
                 time; read more often, or in a separate thread"
            ),
        )
    })
}

/// Ports that the program did not open.
fn not_opened(evidence: &Evidence<'_>) -> Option<Cause> {
    let ports = evidence.ports;
    if ports.is_complete() {
        return None;
    }
    let missing = ports.names(|port| port.is_needed && !port.was_opened);
    let missing = match missing.is_empty() {
        true => ports.names(|port| !port.was_opened),
        false => missing,
    };
    let why = match evidence.ended {
        Some((ended, at)) => {
            let last = last_words(evidence.said);
            let words = last.map_or_else(String::new, |line| format!(" (its last words: {line})"));
            format!("it ended with {ended} at {at} s before that{words}")
        }
        None => match what_for(evidence) {
            waits if waits.is_empty() => "it was still there and did not try".to_owned(),
            waits => waits.trim_start_matches([' ', '(']).replacen(')', "", 1),
        },
    };
    Some(Cause::new(
        weight::NOT_OPENED,
        format!(
            "the program never opened {missing}: {why}; its path is in HILRIG_PORT_<NAME>; name \
             the required ports with --exec-needs"
        ),
    ))
}

/// A program that still reads, but does not resume its work after a fault.
fn not_back(evidence: &Evidence<'_>) -> Option<Cause> {
    let mut checks = evidence.outcome.checks.iter();
    let check = checks.find(|check| check.name == BACK && check.status == Status::Fail)?;
    if evidence.ended.is_some() {
        return None;
    }
    let silent = |port: &&Port| check.detail.contains(&format!("{} to-device", port.name));
    let port = evidence.ports.all.iter().find(silent)?;
    let (name, at) = (&port.name, port.sent_at?);
    let trigger = Trigger::of_silence_at(evidence, at, name);
    let remedy = trigger.as_ref().and_then(Trigger::remedy);
    let after = trigger.map_or_else(String::new, |trigger| trigger.words(at));
    let remedy = remedy.unwrap_or("let it ask again after a timeout");
    let waits = what_for(evidence);
    Some(Cause::new(
        weight::SILENT,
        format!(
            "the program does not go back to work: it sent on {name} last at {at} s{after}{waits}; \
             {remedy}"
        ),
    ))
}

/// A program that still reads, but sends nothing since a fault.
fn stalled(evidence: &Evidence<'_>) -> Option<Cause> {
    let mut checks = evidence.outcome.checks.iter();
    checks.find(|check| check.name == GOES_ON && check.status == Status::Fail)?;
    if evidence.ended.is_some() {
        return None;
    }
    let now = Instant::ZERO + evidence.outcome.ran;
    let port = evidence.ports.stalled(now, &evidence.outcome.case.fault)?;
    let (name, at) = (&port.name, port.sent_at?);
    let trigger = Trigger::of_silence_at(evidence, at, name);
    let after = trigger.map_or_else(String::new, |trigger| trigger.words(at));
    if !port.is_open {
        let text = format!(
            "the program does not open {name} again: it sent there last at {at} s{after}; on an \
             error close the port, wait until its path is there, and open it again"
        );
        return Some(Cause::new(weight::AFTER_FAULT, text));
    }
    let waits = what_for(evidence);
    Some(Cause::new(
        weight::SILENT,
        format!(
            "the program does not ask again: it sent on {name} last at {at} s{after}{waits}; give \
             the wait for a reply a timeout, and ask again"
        ),
    ))
}

/// A program that fell silent or never sent, and the call in which it waits.
fn silent(evidence: &Evidence<'_>) -> Option<Cause> {
    let ports = evidence.ports;
    let failed = |name: &str| {
        let mut checks = evidence.outcome.checks.iter();
        checks.any(|check| check.name == name && check.status == Status::Fail)
    };
    if !failed(GOES_ON) || !ports.is_complete() {
        return None;
    }
    let sent: u64 = ports.all.iter().map(|port| port.from_client).sum();
    let brought: u64 = ports.all.iter().map(|port| port.to_client).sum();
    let has_read = ports.all.iter().any(|port| port.read_at.is_some());
    if let Some((ended, at)) = evidence.ended {
        return (sent == 0).then(|| {
            Cause::new(
                weight::NOTHING_SENT,
                format!(
                    "the program ended with {ended} at {at} s and had sent nothing and read \
                     nothing: it did no work at its ports"
                ),
            )
        });
    }
    if sent == 0 && has_read && evidence.said.trim().is_empty() {
        return Some(Cause::new(
            weight::NOTHING_SENT,
            format!(
                "nothing was observed of the program: it read (last at {} s), but sent and printed \
                 nothing{}; let it print what it reads, or {ALLOW_IT}",
                ports.active_at.unwrap_or_default(),
                what_for(evidence)
            ),
        ));
    }
    let name_of = |path: &Path| {
        let port = ports.all.iter().find(|port| port.path == path);
        port.map_or_else(|| path.display().to_string(), |port| port.name.clone())
    };
    let open = ports.names(|port| port.is_open);
    let read = evidence.waits.iter().find_map(|wait| match wait {
        Wait::Read(path) => ports.all.iter().find(|port| port.path == *path),
        _ => None,
    });
    let since = ports.active_at.map_or_else(
        || "it neither sent nor read anything".to_owned(),
        |at| {
            let trigger = match read {
                Some(port) => Trigger::of_silence_at(evidence, at, &port.name),
                None => Trigger::of_silence(evidence, at),
            };
            let after = trigger.map_or_else(String::new, |trigger| trigger.words(at));
            format!("the last it sent or read was at {at} s{after}")
        },
    );
    let blocked = evidence.waits.iter().find_map(|wait| match wait {
        Wait::ModemLine(path) => Some(format!(
            "waits for a modem line of port {} to change, which its device does not",
            name_of(path)
        )),
        Wait::Read(path) => {
            let port = ports.all.iter().find(|port| port.path == *path)?;
            has_no_timeout(port).then(|| {
                format!(
                    "blocked in a read of port {} without a timeout; give the read a timeout and \
                     ask again",
                    port.name
                )
            })
        }
        Wait::Any { for_ever: true } => Some(format!(
            "blocked in a poll or select without a timeout, port {open} being open; give it a \
             timeout and ask again"
        )),
        Wait::Drain(path) => Some(format!("blocked in tcdrain of port {}", name_of(path))),
        Wait::Write(path) => Some(format!("blocked in a write to {}", name_of(path))),
        _ => None,
    });
    if sent + brought == 0 {
        let waits = blocked.map_or_else(|| what_for(evidence), |text| format!("; it is {text}"));
        return Some(Cause::new(
            weight::NOTHING_SENT,
            format!(
                "the program sent nothing, and its devices only answer requests{waits}; here the \
                 program is the master and must send the first request"
            ),
        ));
    }
    if let Some(text) = blocked {
        return Some(Cause::new(weight::BLOCKED, format!("{text} ({since})")));
    }
    let now = Instant::ZERO + evidence.outcome.ran;
    if ports.active_at.is_some_and(|at| now - at <= SILENT_MAX) {
        return None;
    }
    let waits = what_for(evidence);
    Some(Cause::new(
        weight::SILENT,
        format!("the program fell silent: {since}{waits}"),
    ))
}
