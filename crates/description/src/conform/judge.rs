//! Comparison of a device's answers with those of its twins.

use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet};

use super::probes::Probe;
use super::{
    Answer, Asked, Conformity, Difference, DifferenceKind as Kind, Raw, Seen, Strictness, after,
    samples,
};
use crate::number::{Number, NumberKind};
use crate::reference::number_name;
use crate::schema::wire::Endian;
use crate::speak::Asks;
use crate::value::Value;

/// All values at one place.
#[derive(Debug, Default)]
pub(super) struct Samples<'a>(Vec<&'a Seen>);

impl<'a> Samples<'a> {
    pub(super) fn add(&mut self, seen: &'a Seen) {
        self.0.push(seen);
    }

    fn numbers(&self) -> Option<Vec<f64>> {
        self.0.iter().map(|seen| seen.value.as_f64()).collect()
    }
}

/// The allowed range of values.
struct Range {
    least: f64,
    most: f64,
    margin: f64,
    /// Values grow from twin to twin, as a counter does: the device's value has no upper limit.
    is_rising: bool,
}

impl Range {
    fn has(&self, value: f64) -> bool {
        let above = value >= self.least - self.margin;
        above && (self.is_rising || value <= self.most + self.margin) || value.is_nan()
    }

    fn words(&self) -> String {
        let shown = |value: f64| Value::Float(value).to_string();
        match (self.is_rising, self.least == self.most) {
            (true, _) => format!("{} or more", shown(self.least)),
            (false, true) => shown(self.least),
            (false, false) => format!("about {} to {}", shown(self.least), shown(self.most)),
        }
    }
}

pub(super) fn judge(
    probes: &[Probe],
    twins: &[Vec<Vec<Answer>>],
    asked: &Asked,
    strictness: Strictness,
) -> Conformity {
    let found = &asked.answers[..];
    let mut differences = BTreeSet::new();
    for (at, probe) in probes.iter().enumerate() {
        let expected: Vec<&[Answer]> = twins.iter().map(|twin| &twin[at][..]).collect();
        match probe.listen {
            Some(time) => {
                let odd = after::periods(&expected, &found[at], (time, asked.took[at]));
                differences.extend(odd.into_iter().map(|mut one| {
                    one.place = probe.named(&one.place);
                    one
                }));
            }
            None => differences.extend(answers(probe, &expected, &found[at])),
        }
    }
    latencies(probes, twins, found, strictness, &mut differences);
    values(probes, twins, found, &mut differences);
    differences.extend(after::behind(probes, twins, found));
    let asked = probes
        .iter()
        .zip(found)
        .filter(|(probe, _)| probe.listen.is_none());
    let mut times: Vec<Duration> = asked
        .clone()
        .filter_map(|(_, answers)| Some(answers.first()?.latency))
        .collect();
    times.sort_unstable();
    let at = |share: usize| times.get((times.len().max(1) - 1) * share / 100).copied();
    Conformity {
        requests: asked.clone().count(),
        replies: asked.map(|(_, answers)| answers.len()).sum(),
        latency: at(50).zip(at(99)).map(|(median, high)| [median, high]),
        differences: differences.into_iter().collect(),
        left_out: 0,
        compared: compared(probes, twins, found),
        heard_by_itself: probes
            .iter()
            .zip(found)
            .any(|(probe, answers)| probe.listen.is_some() && !answers.is_empty()),
        unproved: unproved(probes, twins),
        unseen: Vec::new(),
    }
}

/// Whether the description answers a request. A reply to a request that should be refused is
/// optional.
fn is_answered(probe: &Probe) -> bool {
    let has_reply = match &probe.asks {
        Some(Asks::Messages(replies)) => !replies.is_empty(),
        Some(Asks::Modbus { .. }) => true,
        None => false,
    };
    has_reply && !probe.is_strange
}

/// Number of requests that a twin and the device both answered.
fn compared(probes: &[Probe], twins: &[Vec<Vec<Answer>>], found: &[Vec<Answer>]) -> usize {
    let both = probes.iter().enumerate().filter(|(at, probe)| {
        let by_twin = twins.iter().any(|twin| !twin[*at].is_empty());
        is_answered(probe) && by_twin && !found[*at].is_empty()
    });
    let places: BTreeSet<&str> = both.map(|(_, probe)| probe.place.as_str()).collect();
    places.len()
}

/// Requests that the description answers, but no twin did.
fn unproved(probes: &[Probe], twins: &[Vec<Vec<Answer>>]) -> Vec<String> {
    let mut answered: BTreeMap<&str, bool> = BTreeMap::new();
    for (at, probe) in probes.iter().enumerate() {
        if is_answered(probe) {
            let is_answered = twins.iter().any(|twin| !twin[at].is_empty());
            *answered.entry(&probe.place).or_default() |= is_answered;
        }
    }
    let silent = answered.into_iter().filter(|(_, answered)| !answered);
    silent.map(|(place, _)| place.to_owned()).collect()
}

pub(super) fn difference(kind: Kind, place: &str, expected: String, found: String) -> Difference {
    Difference {
        kind,
        place: place.to_owned(),
        expected,
        found,
    }
}

/// The labels of answers, joined as text.
fn labels(answers: &[Answer]) -> String {
    let labels: Vec<_> = answers.iter().map(|answer| answer.label.as_str()).collect();
    match &labels[..] {
        [] => "no reply".to_owned(),
        labels => labels.join(", "),
    }
}

fn answers(probe: &Probe, expected: &[&[Answer]], found: &[Answer]) -> Option<Difference> {
    let is_like = |other: &&&[Answer]| labels(other) == labels(found);
    if let Some(like) = expected.iter().find(is_like) {
        let lens = |answers: &[Answer]| answers.iter().map(|answer| answer.len).collect::<Vec<_>>();
        // A length that differs between the twins gives no rule.
        let is_fixed = expected.iter().all(|other| lens(other) == lens(like));
        let differs = is_fixed && lens(like) != lens(found);
        return differs.then(|| {
            let words = |answers: &[Answer]| {
                let lens = answers.iter().map(|answer| format!("{} bytes", answer.len));
                lens.collect::<Vec<_>>().join(", ")
            };
            difference(Kind::Length, &probe.place, words(like), words(found))
        });
    }
    let first = expected.first().copied().unwrap_or_default();
    let refuses = |answers: &[Answer]| answers.iter().any(|answer| answer.is_refusal);
    let kind = match (first.is_empty(), found.is_empty()) {
        (false, true) => Kind::NoReply,
        (true, false) => Kind::UnexpectedReply,
        _ if refuses(first) || refuses(found) => Kind::Refusal,
        _ => Kind::OtherReply,
    };
    Some(difference(kind, &probe.place, labels(first), labels(found)))
}

fn latencies(
    probes: &[Probe],
    twins: &[Vec<Vec<Answer>>],
    found: &[Vec<Answer>],
    strictness: Strictness,
    out: &mut BTreeSet<Difference>,
) {
    let mut by_place: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (at, probe) in probes
        .iter()
        .enumerate()
        .filter(|(_, probe)| probe.listen.is_none())
    {
        by_place.entry(&probe.place).or_default().push(at);
    }
    for (place, at) in by_place {
        let times = |answers: &[Vec<Answer>]| {
            let times = at
                .iter()
                .filter_map(|at| Some(answers[*at].first()?.latency));
            times.collect::<Vec<_>>()
        };
        let expected: Vec<Duration> = twins.iter().flat_map(|twin| times(twin)).collect();
        let mut own = times(found);
        own.sort_unstable();
        let (Some(least), Some(most)) = (expected.iter().min(), expected.iter().max()) else {
            continue;
        };
        let Some(&median) = own.get(own.len() / 2) else {
            continue;
        };
        let (early, late) = (*least - *least / 5, *most + *most / 5 + strictness.slack);
        if median + strictness.slack < early || median > late {
            let ms = |time: Duration| format!("{:.1} ms", time.as_secs_f64() * 1e3);
            let words = match ms(*least) == ms(*most) {
                true => ms(*least),
                false => format!("{} to {}", ms(*least), ms(*most)),
            };
            out.insert(difference(
                Kind::Latency,
                place,
                words,
                format!("{} (median)", ms(median)),
            ));
        }
    }
}

fn values(
    probes: &[Probe],
    twins: &[Vec<Vec<Answer>>],
    found: &[Vec<Answer>],
    out: &mut BTreeSet<Difference>,
) {
    let all = |answers: &'_ [Vec<Answer>]| answers.iter().flatten().cloned().collect::<Vec<_>>();
    let flat: Vec<Vec<Answer>> = twins.iter().map(|twin| all(twin)).collect();
    let by_twin: Vec<_> = flat.iter().map(|twin| samples(twin.iter())).collect();
    let own = all(found);
    let certain = certain(probes, twins, found);
    for (place, own) in samples(own.iter()) {
        let expected = by_twin.iter().filter_map(|twin| twin.get(place));
        let expected: Vec<&Samples<'_>> = expected.collect();
        let difference = value(place, &expected, &own);
        out.extend(difference.or_else(|| certain.get(place).cloned()));
    }
}

/// Differences from values on which all twins agree for the same request, by place.
fn certain(
    probes: &[Probe],
    twins: &[Vec<Vec<Answer>>],
    found: &[Vec<Answer>],
) -> BTreeMap<String, Difference> {
    let mut differences = BTreeMap::new();
    // After a command, the phase of the messages decides which one shows an event first.
    let is_phased = |probe: &Probe| probe.listen.is_some() && probe.changes;
    let found = found.iter().enumerate();
    for (at, answers) in found.filter(|(at, _)| !is_phased(&probes[*at])) {
        // A reply of several frames contains a place several times.
        let mut times: BTreeMap<&str, usize> = BTreeMap::new();
        for seen in answers.iter().flat_map(|answer| &answer.fields) {
            let time = times.entry(&seen.place).or_default();
            let nth = *time;
            *time += 1;
            let expected = twins.iter().filter_map(|twin| {
                let fields = twin[at].iter().flat_map(|answer| &answer.fields);
                fields.filter(|other| other.place == seen.place).nth(nth)
            });
            let expected: Vec<&Seen> = expected.collect();
            let Some(first) = expected.first().filter(|_| expected.len() == twins.len()) else {
                continue;
            };
            let is_certain = expected.iter().all(|other| other.value == first.value);
            if is_certain && !is_same(first, seen) {
                let words = [first, &seen].map(|seen| seen.value.to_string());
                let [expected, found] = words;
                let difference = difference(Kind::Value, &seen.place, expected, found);
                differences.entry(seen.place.clone()).or_insert(difference);
            }
        }
    }
    differences
}

/// Whether two values are equal within the resolution of the device.
fn is_same(one: &Seen, other: &Seen) -> bool {
    match (one.value.as_f64(), other.value.as_f64()) {
        (Some(a), Some(b)) => (a - b).abs() <= near(&[a, b], one) || a.is_nan() && b.is_nan(),
        _ => one.value == other.value,
    }
}

/// The tolerance within which numbers count as equal.
fn near(numbers: &[f64], seen: &Seen) -> f64 {
    let count = seen.raw.as_ref().map_or(0.0, |raw| raw.scale[0].abs());
    let is_float = matches!(seen.value, Value::Float(_));
    let size = numbers
        .iter()
        .fold(0.0_f64, |most, number| most.max(number.abs()));
    match (is_float, &seen.raw) {
        (false, _) => 0.0,
        // Whole counts differ by at least one.
        (true, Some(raw)) if raw.number.kind != NumberKind::Float => 0.5 * count,
        (true, _) => 1e-6 * size,
    }
}

fn value(place: &str, expected: &[&Samples<'_>], own: &Samples<'_>) -> Option<Difference> {
    let numbers: Option<Vec<Vec<f64>>> = expected.iter().map(|twin| twin.numbers()).collect();
    let (Some(numbers), Some(found)) = (numbers, own.numbers()) else {
        let known: Vec<&Value> = expected
            .iter()
            .flat_map(|twin| &twin.0)
            .map(|seen| &seen.value)
            .collect();
        let other = own.0.iter().find(|seen| !known.contains(&&seen.value))?;
        // A value that differs between the twins gives no rule.
        let is_fixed = expected.windows(2).all(|pair| {
            let values = |twin: &Samples<'_>| {
                twin.0
                    .iter()
                    .map(|seen| seen.value.clone())
                    .collect::<Vec<_>>()
            };
            values(pair[0]) == values(pair[1])
        });
        let first = known.first()?;
        return is_fixed.then(|| {
            difference(
                Kind::Value,
                place,
                first.to_string(),
                other.value.to_string(),
            )
        });
    };
    let range = range(&numbers, own)?;
    let wrong = found.iter().copied().find(|value| !range.has(*value))?;
    let shown = Value::Float(wrong).to_string();
    let raw: Option<Vec<&Raw>> = own.0.iter().map(|seen| seen.raw.as_ref()).collect();
    if let Some(raw) = raw {
        let fits = |other: &dyn Fn(&Raw) -> f64| raw.iter().all(|raw| range.has(other(raw)));
        for number in orders(raw[0].number) {
            if fits(&|raw: &Raw| of(number, raw)) {
                let expected = format!("{} ({})", number_name(raw[0].number), range.words());
                let found = format!("{shown}, would be right as {}", number_name(number));
                return Some(difference(Kind::ByteOrder, place, expected, found));
            }
        }
        let signs = [NumberKind::Unsigned, NumberKind::Signed];
        for kind in signs
            .into_iter()
            .filter(|_| raw[0].number.kind != NumberKind::Float)
        {
            let number = Number {
                kind,
                ..raw[0].number
            };
            if number != raw[0].number && fits(&|raw: &Raw| of(number, raw)) {
                let expected = format!("{} ({})", number_name(raw[0].number), range.words());
                let found = format!("{shown}, would be right as {}", number_name(number));
                return Some(difference(Kind::Sign, place, expected, found));
            }
        }
    }
    for factor in FACTORS {
        if found.iter().all(|value| range.has(value * factor)) && wrong != 0.0 {
            let found = match factor < 1.0 {
                true => format!(
                    "{shown}, {} times as much",
                    Value::Float((1.0 / factor).round())
                ),
                false => format!("{shown}, a {factor}th"),
            };
            return Some(difference(Kind::Scale, place, range.words(), found));
        }
    }
    Some(difference(Kind::Value, place, range.words(), shown))
}

/// Wrong scale factors that are recognised.
const FACTORS: [f64; 14] = [
    0.1,
    10.0,
    0.01,
    100.0,
    0.001,
    1000.0,
    1e-4,
    1e4,
    0.5,
    2.0,
    0.25,
    4.0,
    0.003_906_25,
    256.0,
];

fn of(number: Number, raw: &Raw) -> f64 {
    let [scale, offset] = raw.scale;
    let count = crate::field::number_value(number, &raw.bytes).as_f64();
    count.unwrap_or(f64::NAN) * scale + offset
}

/// The other byte orders of a number.
fn orders(number: Number) -> Vec<Number> {
    let ends = [Endian::Little, Endian::Big];
    let all = ends.into_iter().flat_map(|endian| {
        ends.map(|words| Number {
            endian,
            words,
            ..number
        })
    });
    all.filter(|other| *other != number && number.bytes > 1)
        .collect()
}

/// The range of values that the twins allow.
fn range(numbers: &[Vec<f64>], own: &Samples<'_>) -> Option<Range> {
    let all = || {
        numbers
            .iter()
            .flatten()
            .copied()
            .filter(|value| value.is_finite())
    };
    let least = all().fold(f64::INFINITY, f64::min);
    let most = all().fold(f64::NEG_INFINITY, f64::max);
    if least > most {
        return None;
    }
    let firsts: Vec<f64> = numbers
        .iter()
        .filter_map(|twin| twin.first().copied())
        .collect();
    let is_rising = firsts.len() > 3 && firsts.windows(2).all(|pair| pair[0] < pair[1]);
    let count = own.0.first().and_then(|seen| seen.raw.as_ref());
    let count = count.map_or(0.0, |raw| raw.scale[0].abs());
    let width = most - least;
    let near = own.0.first().map_or(0.0, |seen| near(&[least, most], seen));
    let margin = match width <= 2.0 * near {
        true => near,
        // Noise samples rarely reach the ends of the distribution.
        false => 2.0 * width + count,
    };
    Some(Range {
        least,
        most,
        margin,
        is_rising,
    })
}
