//! Unsolicited messages: how often they come, and the state after commands that they show. Also the
//! parts of a description that no comparison reached.
//!
//! ```text
//! before the command   |----|            samples of the twins
//! after the command                |--|  their samples at the same place in the sequence
//! the device: no difference      ^        behind: ^ (never moved, too slow, wrong way)
//! ```

use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet};

use super::judge::difference;
use super::probes::Probe;
use super::{Answer, Asked, Difference, DifferenceKind as Kind, Seen};
use crate::description::Description;
use crate::schema::message::From;
use crate::value::Value;

/// Share of a change by which a device may lag behind its twins.
const LAG: f64 = 0.2;

/// Least and greatest number.
type Span = [f64; 2];

fn span(numbers: impl Iterator<Item = f64>) -> Option<Span> {
    numbers
        .filter(|number| number.is_finite())
        .fold(None, |span, number| {
            let [least, most] = span.unwrap_or([number; 2]);
            Some([number.min(least), number.max(most)])
        })
}

/// The values of each place in the order of the messages.
fn by_place(answers: &[Answer]) -> BTreeMap<&str, Vec<&Seen>> {
    let mut all: BTreeMap<&str, Vec<&Seen>> = BTreeMap::new();
    for seen in answers.iter().flat_map(|answer| &answer.fields) {
        all.entry(&seen.place).or_default().push(seen);
    }
    all
}

fn numbers(seen: &[&Seen]) -> Vec<f64> {
    let numbers = seen.iter().filter_map(|seen| seen.value.as_f64());
    numbers.collect()
}

/// Whether the messages of the probe `at` come as often as those of the twins.
pub(super) fn is_as_often(
    expected: &[&[Answer]],
    asked: &Asked,
    at: usize,
    time: Duration,
) -> bool {
    periods(expected, &asked.answers[at], (time, asked.took[at])).is_empty()
}

/// Compares the number of unsolicited messages within `time`. A busy computer listens longer, for
/// `took`: more messages are then expected.
pub(super) fn periods(
    expected: &[&[Answer]],
    found: &[Answer],
    (time, took): (Duration, Duration),
) -> Vec<Difference> {
    let counts = |answers: &[Answer]| {
        let mut counts: BTreeMap<String, u64> = BTreeMap::new();
        for answer in answers {
            *counts.entry(answer.label.clone()).or_default() += 1;
        }
        counts
    };
    let twins: Vec<_> = expected.iter().map(|answers| counts(answers)).collect();
    let found = counts(found);
    let names: BTreeSet<&String> = twins
        .iter()
        .chain([&found])
        .flat_map(BTreeMap::keys)
        .collect();
    // The end of the last frame is no lateness.
    let took = if took > time + time / 10 { took } else { time };
    let micros = |time: Duration| u64::try_from(time.as_micros()).unwrap_or(u64::MAX).max(1);
    let [time, passed] = [time, took].map(micros);
    let mut differences = Vec::new();
    for name in names {
        let of = |counts: &BTreeMap<String, u64>| counts.get(name).copied().unwrap_or(0);
        let (least, most) = twins
            .iter()
            .map(of)
            .fold((u64::MAX, 0), |(least, most), count| {
                (least.min(count), most.max(count))
            });
        let least = least.saturating_mul(passed) / time;
        let most = most.saturating_mul(passed).div_ceil(time);
        // Tolerance: one message and a fifth.
        let allowed = least.saturating_sub(1 + least / 5)..=most + 1 + most / 5;
        let count = of(&found);
        if !allowed.contains(&count) {
            let seconds = Value::Float(took.as_secs_f64());
            let words = |count: u64| format!("{count} in {seconds} s");
            let (from, to) = allowed.into_inner();
            let expected = format!("{} ({from} to {to} are allowed)", words(least));
            differences.push(difference(Kind::Period, name, expected, words(count)));
        }
    }
    differences
}

/// Values that did not follow a command as those of all twins did.
pub(super) fn behind(
    probes: &[Probe],
    twins: &[Vec<Vec<Answer>>],
    found: &[Vec<Answer>],
) -> Vec<Difference> {
    let listened = probes.iter().enumerate();
    let listened = listened.filter(|(_, probe)| probe.listen.is_some());
    let listened: Vec<_> = listened.collect();
    let mut differences = Vec::new();
    for pair in listened.windows(2) {
        let (before, (at, probe)) = (pair[0].0, pair[1]);
        for (place, own) in by_place(&found[at]) {
            let of = |at: usize| {
                let twins = twins.iter().map(move |twin| {
                    let all = by_place(&twin[at]);
                    all.get(place).map_or_else(Vec::new, |seen| numbers(seen))
                });
                twins.collect::<Vec<_>>()
            };
            let lag = lag(&of(before), &of(at), &own);
            differences.extend(lag.map(|[expected, found]| {
                difference(Kind::Value, &probe.named(place), expected, found)
            }));
        }
    }
    differences
}

/// The expected and the found value if the last common sample of the device is behind.
fn lag(before: &[Vec<f64>], after: &[Vec<f64>], own: &[&Seen]) -> Option<[String; 2]> {
    let values = numbers(own);
    let len = after.iter().map(Vec::len).chain([values.len()]).min()?;
    let last = len.checked_sub(1)?;
    let found = values[last];
    // The phases of the messages differ by up to one period.
    let window = after
        .iter()
        .flat_map(|twin| &twin[last.saturating_sub(1)..twin.len().min(last + 2)]);
    let [low, high] = span(window.copied())?;
    let [least, most] = span(before.iter().flatten().copied())?;
    let count = own.first().and_then(|seen| seen.raw.as_ref());
    let count = count.map_or(0.0, |raw| raw.scale[0].abs());
    let noise = 2.0 * (most - least) + 0.25 * count;
    let is_behind = if low > most {
        let margin = noise + LAG * (low - most);
        low - margin > most + noise && found < low - margin
    } else {
        let margin = noise + LAG * (least - high);
        high + margin < least - noise && found > high + margin
    };
    let shown = |value: f64| Value::Float(value).to_string();
    let expected = match low == high {
        true => shown(low),
        false => format!("about {} to {}", shown(low), shown(high)),
    };
    is_behind.then(|| [expected, shown(found)])
}

/// Parts of the description that the comparison did not reach, each with the reason.
pub(super) fn unseen(
    of: &Description,
    probes: &[Probe],
    twins: &[Vec<Vec<Answer>>],
    found: &Asked,
) -> Vec<String> {
    let mut unseen = never_sent(of, twins);
    unseen.extend(zeros(twins, &found.answers));
    unseen.extend(hidden(of, probes));
    unseen
}

/// Messages that no twin sent.
fn never_sent(of: &Description, twins: &[Vec<Vec<Answer>>]) -> Vec<String> {
    let answers = twins.iter().flatten().flatten();
    let sent: BTreeSet<&str> = answers.map(|answer| &*answer.label).collect();
    let own = of.messages.iter().filter(|one| one.is_from(From::Device));
    let own = own.filter(|message| !sent.contains(message.name()));
    let own = own.map(|message| format!("{}: the emulated device never sent it", message.name()));
    own.collect()
}

/// Numbers that were always 0: another scale or byte order gives the same 0.
fn zeros(twins: &[Vec<Vec<Answer>>], found: &[Vec<Answer>]) -> Vec<String> {
    let mut is_zero: BTreeMap<&str, bool> = BTreeMap::new();
    let all = twins.iter().flatten().chain(found).flatten();
    for seen in all.flat_map(|answer| &answer.fields) {
        let Some(raw) = &seen.raw else { continue };
        let is_open = raw.number.bytes > 1 || raw.scale != [1.0, 0.0];
        let zero = is_open && raw.bytes.iter().all(|byte| *byte == 0);
        let entry = is_zero.entry(&seen.place).or_insert(true);
        *entry &= zero;
    }
    let zeros = is_zero.into_iter().filter(|(_, is_zero)| *is_zero);
    let words = "was 0 in every message, so its scale and byte order are unknown";
    zeros
        .map(|(place, _)| format!("{place}: {words}"))
        .collect()
}

/// Commands after which no message shows the state.
fn hidden(of: &Description, probes: &[Probe]) -> Vec<String> {
    let is_shown = probes
        .iter()
        .any(|probe| probe.is_again || probe.listen.is_some());
    if of.protocol.is_some() || is_shown {
        return Vec::new();
    }
    let commands = probes
        .iter()
        .filter(|probe| probe.changes && !probe.is_strange);
    let commands: BTreeSet<&str> = commands.map(|probe| &*probe.place).collect();
    let words = "no message shows the state after it";
    commands
        .into_iter()
        .map(|place| format!("{place}: {words}"))
        .collect()
}
