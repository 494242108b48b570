//! The bytes of a replay to ports, and their comparison with the capture.

use protocols::Instant;

use super::{ReplayArgs, judge};
use crate::capture::divergence::Divergence;
use crate::capture::replay::Tally;
use crate::cli::answer::ReplayEnded;
use crate::cli::{Verdict, out};
use crate::realtime::clock::WallClock;
use crate::realtime::playback::{Playback, Socket};
use crate::run::check::Check;

/// The played and received bytes.
pub(super) struct Heard {
    /// Time in the capture.
    pub(super) now: Instant,
    /// Bytes sent and received on each link.
    pub(super) counts: Vec<(String, [u64; 2])>,
    pub(super) divergence: Option<Divergence>,
    /// The state of the conversation on each link.
    pub(super) tallies: Vec<(String, Tally)>,
    pub(super) trace_hash: Option<String>,
}

impl Heard {
    pub(super) fn of(playback: &Playback<WallClock>) -> Self {
        let sockets = playback.sockets().iter();
        let divergences = sockets.clone().filter_map(Socket::divergence);
        Self {
            now: playback.now(),
            tallies: sockets
                .clone()
                .filter_map(|one| Some((one.link().to_owned(), one.talk()?.tally())))
                .collect(),
            divergence: divergences.min_by_key(|divergence| divergence.at),
            counts: sockets
                .map(|socket| (socket.link().to_owned(), socket.counts()))
                .collect(),
            trace_hash: None,
        }
    }
}

/// Prints the played and received bytes, and the comparison if requested; `checks` come from it.
pub(super) fn report(args: &ReplayArgs, heard: &Heard, checks: &[Check]) -> Verdict {
    println!("played {} s", heard.now);
    for (link, [said, came]) in &heard.counts {
        println!("  {link}: {said} B sent, {came} B received");
    }
    for (link, tally) in heard.tallies.iter().filter(|(_, tally)| tally.all > 0) {
        println!("  {link}: {tally}");
    }
    if let Some(hash) = &heard.trace_hash {
        println!("  trace {hash}");
    }
    let first = heard.divergence.as_ref().filter(|_| args.expect);
    let sum = |of: usize| -> u64 { heard.counts.iter().map(|(_, counts)| counts[of]).sum() };
    out::answer(&ReplayEnded {
        played_s: (heard.now - Instant::ZERO).as_secs_f64(),
        bytes_sent: sum(0),
        bytes_back: sum(1),
        checks: checks.to_vec(),
        divergence: first.map(ToString::to_string),
        trace_hash: heard.trace_hash.clone(),
    });
    if !args.expect {
        return Verdict::Pass;
    }
    match (first, heard.tallies.is_empty()) {
        (None, false) => {
            let more = heard
                .tallies
                .iter()
                .map(|(_, tally)| tally.repeated + tally.later);
            let also = match more.sum() {
                0_usize => String::new(),
                more => format!(", and {more} more"),
            };
            println!("no divergence: the program sent the requests of the capture{also}");
            Verdict::Pass
        }
        _ => judge(first, ""),
    }
}
