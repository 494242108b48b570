//! The fielded receiver against a slow and obvious version of itself: that version steps through
//! every microsecond, counts ticks and decrements its counter, where the emulator computes
//! deadlines.

use proptest::collection::vec;
use proptest::prelude::*;
use protocols::Decode;

use super::*;

/// The receiver as its source reads. Times in microseconds.
struct Naive {
    /// Microseconds until the next tick.
    tick_in: u32,
    /// Ticks until the divider counts.
    ticks_left: u32,
    /// Counts until the unfinished frame is discarded; every byte sets it to 1.
    counts_left: u32,
    /// Time since the main loop could first see the expired counter.
    expired_for: u32,
    frame: Vec<u8>,
    deaf_for: u32,
    /// Microseconds since the divider last counted.
    since_count: u32,
    /// A byte came so shortly after a count that the main loop's place decides.
    is_doubtful: bool,
    /// Register of each reply; 255 is the error frame.
    replies: Vec<u8>,
}

impl Naive {
    /// All tasks ran `phase_us` ago.
    fn new(phase_us: u32) -> Self {
        let ticks_gone = phase_us / 1_004;
        Self {
            tick_in: 1_004 - phase_us % 1_004,
            ticks_left: 25 - ticks_gone % 25,
            counts_left: 0,
            expired_for: 0,
            frame: Vec::new(),
            deaf_for: 0,
            since_count: 0,
            is_doubtful: false,
            replies: Vec::new(),
        }
    }

    fn live(&mut self, micros: u32) {
        for _ in 0..micros {
            self.microsecond();
        }
    }

    fn microsecond(&mut self) {
        self.deaf_for = self.deaf_for.saturating_sub(1);
        self.since_count += 1;
        if self.counts_left == 0 && !self.frame.is_empty() {
            self.expired_for += 1;
            if self.expired_for == 100 {
                self.frame.clear();
            }
        }
        self.tick_in -= 1;
        if self.tick_in == 0 {
            self.tick_in = 1_004;
            self.ticks_left -= 1;
        }
        if self.ticks_left == 0 {
            self.ticks_left = 25;
            self.since_count = 0;
            self.counts_left = self.counts_left.saturating_sub(1);
            self.expired_for = 0;
        }
    }

    fn byte(&mut self, byte: u8) {
        if self.deaf_for > 0 {
            return;
        }
        self.counts_left = 1;
        self.is_doubtful |= self.since_count < 1_300;
        if self.frame.is_empty() && byte != 0xAB {
            return;
        }
        self.frame.push(byte);
        let data = match self.frame.get(2) {
            None => return,
            Some(control) if control & 0x80 == 0 => 0,
            Some(control) => usize::from(control & 0x7F),
        };
        if self.frame.len() < 5 + data {
            return;
        }
        let frame = core::mem::take(&mut self.frame);
        let (body, sum) = frame.split_at(frame.len() - 2);
        let expected: u32 = body.iter().map(|&byte| u32::from(byte)).sum();
        let found = u32::from(sum[0]) * 256 + u32::from(sum[1]);
        let reply = if expected == found { frame[1] } else { 0xFF };
        self.replies.push(reply);
        self.deaf_for = 1_500;
    }
}

/// Bytes back to back, and the silence after them. After a whole frame that silence is longer
/// than any reply.
#[derive(Clone, Debug)]
struct Piece {
    register: u8,
    /// The sent part of a frame of five bytes.
    part: core::ops::Range<usize>,
    gap_us: u32,
}

fn piece() -> impl Strategy<Value = Piece> {
    let part = prop_oneof![Just(0..5), Just(0..2), Just(0..3), Just(2..5), Just(3..5)];
    let gap = prop_oneof![2_000_u32..4_000, 2_000_u32..30_000, 24_900_u32..25_400];
    (0_u8..50, part, gap).prop_map(|(register, part, gap_us)| Piece {
        register,
        part,
        gap_us,
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2 * ProptestConfig::default().cases))]

    #[test]
    fn deadlines_are_what_counting_ticks_gives(
        pieces in vec(piece(), 1..20),
        phase_us in 0_u32..25_100,
    ) {
        let phase = Duration::from_micros(u64::from(phase_us));
        let mut bench = Bench::new(with_phase(Profile::Rcj2015, phase));
        let mut naive = Naive::new(phase_us);
        naive.live(10_000);
        for piece in &pieces {
            let frame = Frame::read(piece.register, 1, bench.order());
            let bytes = &frame.as_bytes()[piece.part.clone()];
            bench.send(bytes);
            bench.run(Duration::from_micros(u64::from(piece.gap_us)));
            for &byte in bytes {
                naive.live(10);
                naive.byte(byte);
            }
            naive.live(piece.gap_us);
        }
        if naive.is_doubtful {
            return Ok(());
        }
        let sent = bench.take();
        let replies: Vec<_> = protocols::avr::Decoder::new(bench.order())
            .push(&sent)
            .map(|frame| frame.unwrap().register())
            .collect();
        prop_assert_eq!(replies, naive.replies);
    }
}
