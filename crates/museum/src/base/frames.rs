//! The base's reaction to bytes.

use core::time::Duration;

use emulators::avr_base::AvrBaseConfig;
use emulators::avr_base::profile::Profile;
use protocols::Instant;

use super::bench::{Bench, ERROR, MS, config, read, write};
use crate::{Observation, Variant};

/// Here the sound base is the documented one with its own byte order: the order is the defect.
pub(super) fn av_01(variant: Variant) -> Observation {
    let mut bench = Bench::of(match variant {
        Variant::Defective => config(variant, Profile::Rcj2015),
        Variant::Sound => AvrBaseConfig {
            profile: Profile::Document,
            ..AvrBaseConfig::default()
        },
    });
    let reply = bench.ask(&[0xAB, 0x24, 0x0A, 0xD9, 0x00]);
    bench.seen.figure("bytes of the reply", reply.len());
    bench.judged(reply == ERROR)
}

pub(super) fn av_02(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    let reply = bench.write(45, &[0, 20, 20]);
    bench.run(Duration::from_secs(10));
    let acknowledged = reply == read(45, 0).as_bytes();
    let outcome = if acknowledged {
        "acknowledged"
    } else {
        "refused"
    };
    bench.seen.figure("the write", outcome);
    let moves = bench.moving("wheels after 10 s of silence");
    bench.judged(acknowledged && moves)
}

pub(super) fn av_03a(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    let data = bench.read(50, 10);
    let leaked = data.len().saturating_sub(3);
    bench.seen.figure("bytes from behind register 52", leaked);
    bench.judged(leaked == 7)
}

/// A write beyond the registers is applied, and its acknowledgement has the same bytes as a
/// refusal.
pub(super) fn av_03b(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    let reply = bench.write(255, &[0xFF; 14]);
    let is_refused = reply == ERROR;
    let told = if is_refused {
        "refused"
    } else {
        "something else"
    };
    bench.seen.figure("the write as the master reads it", told);
    let applied = bench.ask_on(read(255, 1).as_bytes()) == write(255, &[0xFF]).as_bytes();
    let outcome = if applied { "applied" } else { "left alone" };
    bench.seen.figure("the memory", outcome);
    bench.judged(is_refused && applied)
}

/// `AB 37 81 FF` writes to the parser's own data pointer. `AB 3B 81 9D` writes to the header of the
/// acknowledging reply. The parser has filled in this header before, so the reply names register
/// 9D.
pub(super) fn av_03c(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    let reply = bench.write(55, &[0xFF]);
    let accepted = reply == read(55, 0).as_bytes();
    let outcome = if accepted { "acknowledged" } else { "refused" };
    bench.seen.figure("a write behind the registers", outcome);
    let reply = bench.write(59, &[0x9D]);
    let named = reply.get(1).copied().filter(|_| reply != ERROR);
    let told = named.map_or_else(|| "none".to_owned(), |register| format!("{register:02X}"));
    bench
        .seen
        .figure("register that the acknowledgement of 59 names", told);
    bench.judged(accepted && named == Some(0x9D))
}

pub(super) fn av_04(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    let reply = bench.write(0, &[0; 127]);
    bench.seen.figure("bytes of the reply", reply.len());
    bench.judged(reply.is_empty())
}

/// The pause lies at a count of the 25.1 ms divider.
pub(super) fn av_06(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    bench.run(Duration::from_micros(24_500) - 10 * MS);
    let frame = read(36, 1);
    bench.send(&frame.as_bytes()[..2]);
    bench.run(MS + MS / 2);
    bench.send(&frame.as_bytes()[2..]);
    bench.run(MS);
    let reply = bench.take();
    bench.seen.figure("bytes of the reply", reply.len());
    bench.judged(reply.is_empty())
}

pub(super) fn av_07(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    let replies = bench.ask(&read(36, 1).as_bytes().repeat(2)).len() / 6;
    bench.seen.figure("of two requests answered", replies);
    bench.judged(replies == 1)
}

/// Frames that end around a divider's count, one at each count, in steps of 40 ns. Of frames at
/// arbitrary times, 5 in 100,000 vanish.
pub(super) fn av_21(variant: Variant) -> Observation {
    const COUNT: Duration = Duration::from_micros(25_100);
    const FRAMES: u32 = 1_000;
    let mut bench = Bench::new(variant);
    let frame = read(36, 1);
    let lost = (0..FRAMES).filter(|&index| {
        // 45 us before the count to 5 us before it; the frame itself takes 50 us.
        let begins = COUNT * (index + 1) + Duration::from_nanos(40) * index;
        let at = Instant::ZERO + (begins - Duration::from_micros(45));
        !bench.answers_at(at, frame.as_bytes())
    });
    let lost = lost.count();
    bench.seen.figure("sound frames sent", FRAMES);
    let all = if lost == 0 { "all" } else { "not all" };
    bench.seen.figure("of them answered", all);
    bench.judged(lost > 0)
}

/// A read of all 53 registers, then the next request while the reply fills the ring of 31 bytes.
pub(super) fn av_08(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    bench.send(read(0, 53).as_bytes());
    bench.run(MS / 5);
    bench.send(read(36, 1).as_bytes());
    bench.run(2 * MS);
    let answers = bench.take().len();
    bench.seen.figure("bytes of both replies", answers);
    bench.judged(answers == 53 + 5)
}

pub(super) fn av_09(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    let reply = bench.ask(&[0xAB, 0xAB, 0x24, 0x0A, 0x00, 0xD9]);
    let answered = reply.ends_with(write(36, &[0; 10]).as_bytes());
    let outcome = if answered { "answered" } else { "lost" };
    bench.seen.figure("the request", outcome);
    bench.judged(reply == ERROR)
}

/// A header that announces 126 bytes, then after 3 ms a valid frame.
pub(super) fn av_10(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    bench.send(&[0xAB, 0x00, 0xFE]);
    bench.run(3 * MS);
    bench.send(read(36, 1).as_bytes());
    bench.run(MS);
    let reply = bench.take();
    let answered = reply.ends_with(write(36, &[0]).as_bytes());
    let outcome = if answered { "answered" } else { "swallowed" };
    bench.seen.figure("a request 3 ms later", outcome);
    bench.judged(!answered)
}

pub(super) fn av_11(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    let reply = bench.write(35, &[0x55]);
    let acknowledged = reply == read(35, 0).as_bytes();
    let kept = bench.read(35, 1) == [0x55];
    let outcome = if acknowledged {
        "acknowledged"
    } else {
        "refused"
    };
    bench.seen.figure("a write to register 35", outcome);
    bench.seen.figure("the value is still there", kept);
    bench.judged(acknowledged && !kept)
}

pub(super) fn av_20(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    let reply = bench.write(255, &[0x55]);
    let written = bench.ask_on(read(255, 1).as_bytes()) == write(255, &[0x55]).as_bytes();
    bench
        .seen
        .figure("written in spite of the error frame", written);
    bench.judged(reply == ERROR && written)
}
