//! A conversation of a driver and a device: exchanges, and bursts without a request.

use core::time::Duration;

use description::peer::Peer;
use protocols::{Instant, LineConfig};

use super::{float, ms};
use crate::replay::{Arrival, Passage};

/// Pause that ends a request or a burst. Adapters hold bytes back for up to 16 ms.
const PAUSE: Duration = Duration::from_millis(20);
/// Time of the emulation after the last exchange of a capture.
const SETTLE: Duration = Duration::from_millis(500);

/// Bytes of the device without a pause between them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Burst {
    /// Start of the first byte.
    pub(super) start: Instant,
    /// End of the last byte.
    pub(super) end: Instant,
    pub(super) bytes: Vec<u8>,
}

/// A request, and the burst behind it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Exchange {
    pub(super) request: Vec<u8>,
    /// End of its last byte.
    pub(super) end: Instant,
    pub(super) reply: Option<Burst>,
}

/// A conversation.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Talk {
    pub(super) exchanges: Vec<Exchange>,
    /// Bursts that are no replies.
    pub(super) unasked: Vec<Burst>,
}

impl Talk {
    /// The conversation of a capture.
    pub(super) fn captured(passage: &Passage) -> Self {
        let line = passage.line();
        let requests = requests(passage, line);
        // Some logs have the time of the first byte, not of the last one: a reply does not begin
        // before the request that was logged before it.
        let asked = |at: Instant| {
            let count = requests.partition_point(|(end, _)| *end <= at);
            requests[..count]
                .last()
                .map(|(end, _)| *end)
                .unwrap_or_default()
        };
        let pieces = passage.arrivals.iter().map(|arrival| {
            let time = line.bytes_time(arrival.bytes.len() as u64);
            let start = earlier(arrival.at, time).max(asked(arrival.at));
            (start, arrival.bytes.clone())
        });
        let pieces = pieces.collect();
        Self::of(requests, pieces, line)
    }

    /// Sends the same requests at the same times to `peer`, which has run for `warm_up` before;
    /// returns the conversation.
    pub(super) fn played(
        real: &Self,
        line: LineConfig,
        peer: &mut dyn Peer,
        warm_up: Duration,
    ) -> Result<Self, String> {
        let zero = peer.now() + warm_up;
        let mut pieces = Vec::new();
        let mut listen = |peer: &mut dyn Peer, until: Instant| -> Result<(), String> {
            while let Some((start, bytes)) = peer.hear(until)? {
                if start >= zero {
                    pieces.push((Instant::ZERO + (start - zero), bytes));
                }
            }
            Ok(())
        };
        listen(peer, zero)?;
        let mut requests = Vec::new();
        for exchange in &real.exchanges {
            let time = line.bytes_time(exchange.request.len() as u64);
            listen(peer, zero + (earlier(exchange.end, time) - Instant::ZERO))?;
            let end = peer.send(&exchange.request)?;
            let end = Instant::ZERO + (end - zero);
            requests.push((end, exchange.request.clone()));
        }
        let end = zero + (real.end() - Instant::ZERO);
        // The last reply may be later than the captured one. A device that sends without requests
        // is compared over the same time.
        let settle = match real.unasked.last().map(|burst| burst.end) {
            Some(last) if last >= real.end() => Duration::ZERO,
            _ => SETTLE,
        };
        listen(peer, end + settle)?;
        Ok(Self::of(requests, pieces, line))
    }

    fn of(
        requests: Vec<(Instant, Vec<u8>)>,
        pieces: Vec<(Instant, Vec<u8>)>,
        line: LineConfig,
    ) -> Self {
        let ends: Vec<Instant> = requests.iter().map(|(end, _)| *end).collect();
        // The number of requests that end before `at`; a clock of a log rounds to milliseconds.
        let asked = |at: Instant| ends.partition_point(|end| *end <= at + Duration::from_millis(1));
        let mut bursts: Vec<(usize, Burst)> = Vec::new();
        for (start, bytes) in pieces {
            let end = start + line.bytes_time(bytes.len() as u64);
            let behind = asked(start);
            match bursts.last_mut() {
                Some((same, last)) if *same == behind && start - last.end < PAUSE => {
                    last.bytes.extend(bytes);
                    last.end = end;
                }
                _ => bursts.push((behind, Burst { start, end, bytes })),
            }
        }
        let mut this = Self::default();
        for (end, request) in requests {
            this.exchanges.push(Exchange {
                request,
                end,
                reply: None,
            });
        }
        for (behind, burst) in bursts {
            let exchange = behind
                .checked_sub(1)
                .map(|index| &mut this.exchanges[index]);
            match exchange {
                Some(exchange) if exchange.reply.is_none() => exchange.reply = Some(burst),
                _ => this.unasked.push(burst),
            }
        }
        this
    }

    /// End of the last request or burst.
    fn end(&self) -> Instant {
        let replies = self.exchanges.iter().filter_map(|one| one.reply.as_ref());
        let bursts = replies.chain(&self.unasked).map(|burst| burst.end);
        let requests = self.exchanges.iter().map(|one| one.end);
        bursts.chain(requests).max().unwrap_or_default()
    }

    /// All messages of the device, each with its request; bursts have an empty one.
    pub(super) fn messages(&self) -> impl Iterator<Item = (&[u8], &[u8])> {
        let replies = self.exchanges.iter().filter_map(|one| {
            let reply = one.reply.as_ref()?;
            Some((&one.request[..], &reply.bytes[..]))
        });
        let bursts = self.unasked.iter().map(|burst| (&[][..], &burst.bytes[..]));
        replies.chain(bursts)
    }

    /// Times from the end of a request to the start of its reply, milliseconds.
    pub(super) fn latencies_ms(&self) -> Vec<f64> {
        let replied = self
            .exchanges
            .iter()
            .filter_map(|one| Some(ms(one.end, one.reply.as_ref()?.start)));
        replied.collect()
    }

    /// Times between the starts of bursts without a request between them, milliseconds.
    pub(super) fn periods_ms(&self) -> Vec<f64> {
        let asked = |at: Instant| self.exchanges.partition_point(|one| one.end < at);
        let pairs = self.unasked.windows(2);
        let starts = pairs.map(|pair| (pair[0].start, pair[1].start));
        let periods = starts.filter(|(from, to)| asked(*from) == asked(*to));
        periods.map(|(from, to)| ms(from, to)).collect()
    }

    /// Lengths of the bursts without a request.
    pub(super) fn burst_lengths(&self) -> Vec<f64> {
        self.unasked
            .iter()
            .map(|burst| float(burst.bytes.len()))
            .collect()
    }

    /// Whether the next request follows the burst without a pause: then it may be part of a stream.
    pub(super) fn is_cut(&self, burst: &Burst) -> bool {
        let behind = self.exchanges.partition_point(|one| one.end <= burst.end);
        let next = self.exchanges.get(behind);
        next.is_some_and(|next| next.end - burst.end < PAUSE)
    }

    /// Whether a burst lasts for `time`.
    pub(super) fn has_stream(&self, time: Duration) -> bool {
        let replies = self.exchanges.iter().filter_map(|one| one.reply.as_ref());
        replies
            .chain(&self.unasked)
            .any(|burst| burst.end - burst.start >= time)
    }

    /// Bytes from the device a second.
    pub(super) fn bytes_per_s(&self) -> Option<f64> {
        let replies = self.exchanges.iter().filter_map(|one| one.reply.as_ref());
        let bytes: usize = replies
            .chain(&self.unasked)
            .map(|burst| burst.bytes.len())
            .sum();
        let seconds = (self.end() - Instant::ZERO).as_secs_f64();
        (bytes > 0 && seconds > 0.0).then(|| float(bytes) / seconds)
    }
}

/// Requests of a capture: bytes to the device without a pause, and without an answer, between them.
fn requests(passage: &Passage, line: LineConfig) -> Vec<(Instant, Vec<u8>)> {
    let is_answered = |from: Instant, to: Instant| {
        let behind = passage
            .arrivals
            .partition_point(|arrival| arrival.at <= from);
        passage
            .arrivals
            .get(behind)
            .is_some_and(|arrival| arrival.at < to)
    };
    let mut requests: Vec<(Instant, Vec<u8>)> = Vec::new();
    for Arrival { at, bytes } in &passage.heard {
        let start = earlier(*at, line.bytes_time(bytes.len() as u64));
        match requests.last_mut() {
            Some((end, request)) if start - *end < PAUSE && !is_answered(*end, start) => {
                request.extend(bytes);
                *end = *at;
            }
            _ => requests.push((*at, bytes.clone())),
        }
    }
    requests
}

fn earlier(at: Instant, by: Duration) -> Instant {
    Instant::ZERO + (at - Instant::ZERO).saturating_sub(by)
}
