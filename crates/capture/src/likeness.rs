//! Likeness of an emulated device to a captured one.
//!
//! The emulated device gets the requests of a capture at their captured times. Figures of both
//! conversations are compared: replies, latencies, periods, lengths. Values are shown at most: they
//! depend on the surroundings of the device, and so do bytes of a single unit, e.g. a serial
//! number.

mod talk;

use core::time::Duration;
use std::collections::BTreeMap;

use description::peer::Peer;
use emulators::figure::{Comparison, Limit};
use protocols::Instant;

use crate::replay::Passage;
use talk::{Burst, Talk};

/// Time that the emulated device runs before the capture begins.
const WARM_UP: Duration = Duration::from_secs(2);
/// Number of unasked bursts from which their figures are judged.
const BURSTS_MIN: usize = 5;
/// Duration from which a burst is a stream: its length depends on the requests around it.
const STREAM: Duration = Duration::from_millis(200);
/// Number of replies to one request, or of bursts of one length, from which a byte is constant.
const CONSTANT_MIN: usize = 3;
/// Maximum number of constant bytes that are named.
const NAMED_MAX: usize = 8;

/// The comparison of two conversations.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Likeness {
    /// The figures, in order.
    pub figures: Vec<Comparison>,
    /// Bytes that never change in the capture and differ in the emulation, in words.
    pub constants: Vec<String>,
}

impl Likeness {
    /// Whether at least one figure is judged, and all judged ones agree.
    pub fn holds(&self) -> bool {
        let mut judged = self.figures.iter().filter_map(Comparison::holds).peekable();
        judged.peek().is_some() && judged.all(|holds| holds)
    }
}

/// Plays the requests of `passage` to `peer`, and compares both conversations. A latency may differ
/// by a fifth, or by `slack` if that is more.
///
/// # Errors
/// If the peer is gone.
pub fn compare(
    passage: &Passage,
    peer: &mut dyn Peer,
    slack: Duration,
) -> Result<Likeness, String> {
    let real = Talk::captured(passage);
    let ours = Talk::played(&real, passage.line(), peer, WARM_UP)?;
    Ok(Likeness {
        figures: figures(&real, &ours, slack),
        constants: constants(&real, &ours),
    })
}

fn figures(real: &Talk, ours: &Talk, slack: Duration) -> Vec<Comparison> {
    let row = |name: &str, unit, [real, ours]: [Option<f64>; 2], limit| Comparison {
        name: name.to_owned(),
        unit,
        real,
        ours,
        limit,
    };
    let both = |figure: &dyn Fn(&Talk) -> Option<f64>| [figure(real), figure(ours)];
    let mut rows = vec![
        row(
            "requests",
            "",
            both(&|talk| some(talk.exchanges.len())),
            Limit::Free,
        ),
        row(
            "requests with a reply",
            "%",
            both(&replied),
            Limit::Plus(5.0),
        ),
        row(
            "replies of the captured length",
            "%",
            lengths(real, ours),
            Limit::Plus(5.0),
        ),
        row(
            "constant bytes alike",
            "%",
            constant_share(real, ours),
            Limit::Free,
        ),
    ];
    let slack_ms = slack.as_secs_f64() * 1e3;
    for (name, quantile) in [("10 %", 0.1), ("median", 0.5), ("90 %", 0.9)] {
        let found = both(&|talk| at_quantile(talk.latencies_ms(), quantile));
        let allowed = found[0].map_or(slack_ms, |real| (real * 0.2).max(slack_ms));
        rows.push(row(
            &format!("latency, {name}"),
            "ms",
            found,
            Limit::Plus(allowed),
        ));
    }
    let is_periodic = real.unasked.len() >= BURSTS_MIN;
    let judged = |limit| if is_periodic { limit } else { Limit::Free };
    let unasked = both(&|talk| some(talk.unasked.len()));
    // A burst counts as a reply if a request comes shortly before it, which depends on chance.
    let count = real.unasked.len() as f64;
    let by_chance = if real.exchanges.is_empty() {
        0.0
    } else {
        count.sqrt()
    };
    rows.push(row(
        "bursts without a request",
        "",
        unasked,
        judged(Limit::Plus(count * 0.1 + by_chance)),
    ));
    let length = both(&|talk| at_quantile(talk.burst_lengths(), 0.5));
    rows.push(row(
        "bytes of a burst, median",
        "",
        length,
        judged(Limit::Share(0.1)),
    ));
    let period = both(&|talk| at_quantile(talk.periods_ms(), 0.5));
    let allowed = period[0].map_or(0.0, |real| (real * 0.05).max(0.5));
    rows.push(row(
        "period of bursts, median",
        "ms",
        period,
        judged(Limit::Plus(allowed)),
    ));
    let spread = both(&|talk| {
        let [low, high] = [0.1, 0.9].map(|quantile| at_quantile(talk.periods_ms(), quantile));
        Some(high? - low?)
    });
    rows.push(row(
        "period of bursts, 10 to 90 %",
        "ms",
        spread,
        judged(Limit::Plus(slack_ms)),
    ));
    let rate = both(&Talk::bytes_per_s);
    // The rate of replies is that of the requests.
    let is_rate_own = is_periodic || real.exchanges.is_empty() || real.has_stream(STREAM);
    rows.push(row(
        "bytes from the device per second",
        "",
        rate,
        if is_rate_own {
            Limit::Share(0.1)
        } else {
            Limit::Free
        },
    ));
    rows
}

fn some(count: usize) -> Option<f64> {
    (count > 0).then(|| float(count))
}

fn float(count: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "counts of one capture")]
    let count = count as f64;
    count
}

fn percent(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| 100.0 * float(part) / float(whole))
}

fn replied(talk: &Talk) -> Option<f64> {
    let replied = talk.exchanges.iter().filter(|one| one.reply.is_some());
    percent(replied.count(), talk.exchanges.len())
}

/// Replies of both conversations to the same request.
fn pairs<'a>(real: &'a Talk, ours: &'a Talk) -> impl Iterator<Item = (&'a [u8], [&'a Burst; 2])> {
    real.exchanges
        .iter()
        .zip(&ours.exchanges)
        .filter_map(|(real, ours)| {
            Some((
                &real.request[..],
                [real.reply.as_ref()?, ours.reply.as_ref()?],
            ))
        })
}

fn lengths(real: &Talk, ours: &Talk) -> [Option<f64>; 2] {
    let is_whole = |[real_reply, _]: &[&Burst; 2]| {
        real_reply.end - real_reply.start < STREAM && !real.is_cut(real_reply)
    };
    let messages = || pairs(real, ours).filter(|(_, replies)| is_whole(replies));
    let alike = messages().filter(|(_, [a, b])| a.bytes.len() == b.bytes.len());
    let count = messages().count();
    [percent(count, count), percent(alike.count(), count)]
}

/// A byte that has one value in all messages of a kind.
struct Constant {
    /// The request, or nothing for bursts without one.
    request: Vec<u8>,
    /// Offset in the message.
    at: usize,
    byte: u8,
    /// Values in the emulated messages, with their numbers.
    ours: BTreeMap<u8, usize>,
}

/// Messages by their request and length: captured and emulated ones.
type Messages<'a> = BTreeMap<(&'a [u8], usize), [Vec<&'a [u8]>; 2]>;

/// Constant bytes of the captured messages. Messages of a kind answer the same request, or no
/// request, and have the same length.
fn constant_bytes(real: &Talk, ours: &Talk) -> Vec<Constant> {
    let mut kinds = Messages::new();
    for (column, talk) in [real, ours].into_iter().enumerate() {
        for (request, bytes) in talk.messages() {
            kinds.entry((request, bytes.len())).or_default()[column].push(bytes);
        }
    }
    let mut constants = Vec::new();
    for ((request, len), [real, ours]) in &kinds {
        if real.len() < CONSTANT_MIN || ours.is_empty() {
            continue;
        }
        for at in 0..*len {
            let byte = real[0][at];
            if real.iter().any(|message| message[at] != byte) {
                continue;
            }
            let mut values = BTreeMap::new();
            for message in ours {
                *values.entry(message[at]).or_insert(0) += 1;
            }
            constants.push(Constant {
                request: request.to_vec(),
                at,
                byte,
                ours: values,
            });
        }
    }
    constants
}

fn constant_share(real: &Talk, ours: &Talk) -> [Option<f64>; 2] {
    let constants = constant_bytes(real, ours);
    let whole: usize = constants.iter().flat_map(|one| one.ours.values()).sum();
    let alike = constants.iter().filter_map(|one| one.ours.get(&one.byte));
    [percent(whole, whole), percent(alike.sum(), whole)]
}

fn constants(real: &Talk, ours: &Talk) -> Vec<String> {
    let differ = constant_bytes(real, ours)
        .into_iter()
        .filter(|one| one.ours.keys().any(|value| *value != one.byte));
    let words = differ.map(|one| {
        let kind = match &one.request[..] {
            [] => "bursts without a request".to_owned(),
            bytes => format!("replies to {}", engine::hex::pairs(bytes)),
        };
        let other = one.ours.iter().filter(|(value, _)| **value != one.byte);
        let most = other.max_by_key(|(_, count)| **count);
        let (value, _) = most.expect("one of them differs");
        format!(
            "{kind}: byte {} is {:02X}, emulated {value:02X}",
            one.at, one.byte
        )
    });
    let mut words: Vec<String> = words.collect();
    let more = words.len().saturating_sub(NAMED_MAX);
    words.truncate(NAMED_MAX);
    if more > 0 {
        words.push(format!("and {more} more"));
    }
    words
}

/// The value below which the share `quantile` of `values` lies.
fn at_quantile(mut values: Vec<f64>, quantile: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an index"
    )]
    let index = (float(values.len().checked_sub(1)?) * quantile).round() as usize;
    values.get(index).copied()
}

fn ms(from: Instant, to: Instant) -> f64 {
    (to - from).as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests;
