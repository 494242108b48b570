//! Hall values in the board's frames. The fielded host reads through a terminal that turns CR into
//! LF. It loses a byte when a read returns without one, and it has no checks. The report attributes
//! the damaged frames to interference.

use core::time::Duration;
use std::sync::{Arc, Mutex};

use emulators::rng::Rng;
use protocols::car_board::{Decoder, FieldedDecoder, Readings};
use protocols::tty::InputMode;
use protocols::{Decode as _, Instant};

use super::super::runs::{Spread, each};
use super::super::{Figure, Findings, Plan, Plot, Table};
use super::told;
use engine::rig::line::Direction;
use engine::rig::trace::{Side, Tap};

/// Shares of the reads that lose their byte; the share in the field is unknown.
pub(in super::super) const LOST: [f64; 6] = [0.0, 0.05, 0.1, 0.15, 0.2, 0.3];
/// Share that the figures use.
pub(in super::super) const GUESS: f64 = 0.2;
/// Duration of the drive along a hall at 22 cm/s.
const DRIVEN: Duration = Duration::from_secs(60);
/// Maximum gap between bytes of one frame.
const GAP: Duration = Duration::from_millis(10);

/// Bytes of the board's link as they were sent, each with its time.
#[derive(Clone, Debug, Default)]
struct Sent(Arc<Mutex<Vec<(Instant, u8)>>>);

impl Tap for Sent {
    fn record(&mut self, link: usize, to: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if (link, to, side) == (0, Direction::ToMaster, Side::Sent)
            && let Ok(mut sent) = self.0.lock()
        {
            sent.extend(bytes.iter().map(|byte| (at, *byte)));
        }
    }
}

pub(super) fn perform(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let seeds: Vec<u64> = (1..=plan.seeds).collect();
    let found = each(plan, &seeds, tell, |seed| rates(*seed));
    let median = |of: &dyn Fn(&Rates) -> f64| Spread::of(found.iter().map(of)).median;
    let mut table = Table::new(["bytes lost (share)", "usable values (1/s)"]);
    let mut curve = Vec::new();
    for (index, lost) in LOST.into_iter().enumerate() {
        let rate = median(&|rates| rates.fielded[index]);
        table.push("fielded host", [lost, rate]);
        curve.push([lost, rate]);
    }
    let sound = median(&|rates| rates.sound);
    table.push("whole frames", [f64::NAN, sound]);
    let plot = Plot::new(
        "Usable hall values",
        [
            "share of the bytes that the host loses",
            "usable values (1/s)",
        ],
    )
    .line("fielded host", curve)
    .line("host of whole frames", [[0.0, sound], [0.3, sound]]);
    let guess = LOST
        .iter()
        .position(|lost| *lost == GUESS)
        .unwrap_or_default();
    let of_guess = Spread::of(found.iter().map(|rates| rates.fielded[guess]));
    let shown = |rate: f64| format!("{rate:.2} /s");
    let figures = vec![
        Figure::new(
            "fielded host that loses a fifth of its bytes",
            format!("{}, at most {:.2}", shown(of_guess.median), of_guess.worst),
            "less than 1 /s",
        ),
        Figure::new(
            "fielded host, CR made LF alone",
            shown(median(&|rates| rates.fielded[0])),
            "",
        ),
        Figure::new("host of whole frames", shown(sound), ""),
        Figure::new("frames sent", shown(median(&|rates| rates.frames)), ""),
    ];
    Findings {
        table,
        plot,
        figures,
    }
}

/// Values a second.
pub(in super::super) struct Rates {
    frames: f64,
    pub(in super::super) sound: f64,
    /// Rates of the fielded host, one for each of [`LOST`].
    pub(in super::super) fielded: Vec<f64>,
}

pub(in super::super) fn rates(seed: u64) -> Rates {
    let mut run = told([40.0, 6.0], [2, 8], seed);
    let sent = Sent::default();
    run.rig.add_tap(Box::new(sent.clone()));
    run.go_on_until(Instant::ZERO + DRIVEN);
    let sent = sent.0.lock().map(|sent| sent.clone()).unwrap_or_default();
    let frames: Vec<_> = sent.chunk_by(|one, next| next.0 - one.0 < GAP).collect();
    let truth = frames.iter().filter_map(|frame| {
        let hall = [frame.get(9)?.1, frame.get(10)?.1];
        Some((frame.last()?.0, u16::from_le_bytes(hall)))
    });
    let truth: Vec<(Instant, u16)> = truth.collect();
    let per_second = |count: usize| count as f64 / DRIVEN.as_secs_f64();
    let usable = |read: Vec<(Instant, Readings)>| {
        let is_true = |(at, it): &&(Instant, Readings)| truth.contains(&(*at, it.hall));
        per_second(read.iter().filter(is_true).count())
    };
    let fielded = LOST.map(|lost| usable(by_fielded_host(&sent, lost, seed)));
    Rates {
        frames: per_second(truth.len()),
        sound: usable(by_frames(&frames)),
        fielded: fielded.to_vec(),
    }
}

fn by_fielded_host(sent: &[(Instant, u8)], lost: f64, seed: u64) -> Vec<(Instant, Readings)> {
    let mut parser = FieldedDecoder::default();
    let mut short_reads = Rng::stream(seed, "short-reads");
    let mut read = Vec::new();
    for (at, byte) in sent {
        if !short_reads.chance(lost) {
            let frame = parser.push(InputMode::CrToNl.read(*byte));
            read.extend(frame.map(|frame| (*at, frame.readings())));
        }
    }
    read
}

fn by_frames(frames: &[&[(Instant, u8)]]) -> Vec<(Instant, Readings)> {
    let mut decoder = Decoder::default();
    let mut read = Vec::new();
    for frame in frames {
        let bytes: Vec<u8> = frame.iter().map(|(_, byte)| *byte).collect();
        let mut found: Vec<_> = decoder.push(&bytes).flatten().collect();
        decoder.idle();
        found.extend(decoder.push(&[]).flatten());
        let ends = frame.last().map_or(Instant::ZERO, |(at, _)| *at);
        read.extend(found.iter().map(|frame| (ends, frame.readings())));
    }
    read
}
