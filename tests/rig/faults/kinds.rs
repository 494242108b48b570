//! Each kind of fault of a line, observed on the wire: where, how often, and nowhere else.

use std::path::Path;

use hilrig::scenario::{FaultKind, FaultPlace, Scenario};
use protocols::Instant;

use super::wire::{SENT, Seen, one, run, run_each};

/// One kind, its keys, and its expected effect.
struct Row {
    /// Keys of a fault that strikes.
    keys: &'static str,
    /// Maximum length of the pieces that are sent.
    piece: usize,
    sees: Sees,
}

enum Sees {
    /// The bytes that arrive, written by hand.
    Text(&'static str),
    /// This condition holds for the received bytes with and without the fault.
    That(fn(&Seen, &Seen)),
}

/// Bytes leave at 0, 1, 2 .. and arrive one byte time later; the fourth is byte 3.
const PLAIN: &str = "1:00 2:0d 3:11 4:13 5:81 6:05 7:06 8:07 9:08 10:09";
/// Bytes 3 and 4 are sent in this window, and bytes 2 and 3 arrive in it.
const SHORT: &str = "from = \"10300us\"\nuntil = \"10500us\"";
/// Bytes 3 to 6 arrive in this window; byte 2 arrives at its start.
const LONG: &str = "from = \"10300us\"\nuntil = \"10800us\"";

/// Keys with which a fault never strikes.
fn never(kind: FaultKind, keys: &str) -> String {
    if kind.is_strike() {
        let needed: Vec<&str> = keys.lines().filter(|key| key.starts_with("by ")).collect();
        return format!("rate = 0.0\n{}", needed.join("\n"));
    }
    let timeless = keys.lines().filter(|key| {
        let key = key.split(' ').next().expect("not empty");
        !["from", "until", "every", "lasting"].contains(&key)
    });
    let timeless: Vec<&str> = timeless.collect();
    let count = "every = \"1ms\"\nlasting = \"1ms\"\ncount = 0";
    format!("{count}\n{}", timeless.join("\n"))
}

fn text(keys: &'static str, seen: &'static str) -> Row {
    let (piece, sees) = (1, Sees::Text(seen));
    Row { keys, piece, sees }
}

fn that(keys: &'static str, sees: fn(&Seen, &Seen)) -> Row {
    let (piece, sees) = (1, Sees::That(sees));
    Row { keys, piece, sees }
}

/// The row of a kind; a kind without a row does not compile. `None`: the kind acts on devices, see
/// `devices`.
fn row(kind: FaultKind) -> Option<Row> {
    use FaultKind as K;
    Some(match kind {
        K::Flip | K::Drop | K::Insert | K::Duplicate | K::Burst | K::Truncate => bytes(kind),
        K::Swap | K::ParityError | K::Idle => bytes(kind),
        K::StripNul => text("", "2:0d 3:11 4:13 5:81 6:05 7:06 8:07 9:08 10:09"),
        K::CrToLf => text("", "1:00 2:0a 3:11 4:13 5:81 6:05 7:06 8:07 9:08 10:09"),
        K::EatXonXoff => text("", "1:00 2:0d 5:81 6:05 7:06 8:07 9:08 10:09"),
        K::ClearBit7 => text("", "1:00 2:0d 3:11 4:13 5:01 6:05 7:06 8:07 9:08 10:09"),
        K::Cut => text(SHORT, "1:00 2:0d 3:11 6:05 7:06 8:07 9:08 10:09"),
        K::Unplugged => text(
            SHORT,
            "1:00 2:0d 3:11 3:!closed 5:!opened 6:05 7:06 8:07 9:08 10:09",
        ),
        K::Break => text(SHORT, "1:00 2:0d 3:11 3:!break 6:05 7:06 8:07 9:08 10:09"),
        K::Stall => text(LONG, "1:00 2:0d 3:11 8:13 8:81 8:05 8:06 8:07 9:08 10:09"),
        K::Overrun | K::ShortRead | K::Latency | K::Jitter | K::Clog => timing(kind),
        K::Echo => that("", the_sender_hears_itself),
        // Between the ends of this fault, at 3 and 8, bytes 3 to 7 arrive.
        K::Swizzle => that(
            "with = \"b\"\nfrom = \"10300us\"\nuntil = \"10800us\"",
            receivers_change_places,
        ),
        K::WrongBaud => that("baud = 50_000", half_the_rate),
        K::PowerDip | K::Off | K::Intermittent | K::Restart | K::Stuck | K::Garbage => return None,
        K::Wrong | K::Slow | K::Delayed | K::Device => return None,
    })
}

/// Damage to byte 3 and the bytes behind it.
fn bytes(kind: FaultKind) -> Row {
    use FaultKind as K;
    match kind {
        // Byte 13 is 0001 0011; with bit 7 flipped it is 93.
        K::Flip => text(
            "byte = 3\nbit = 7",
            "1:00 2:0d 3:11 4:93 5:81 6:05 7:06 8:07 9:08 10:09",
        ),
        K::Drop => text("byte = 3", "1:00 2:0d 3:11 5:81 6:05 7:06 8:07 9:08 10:09"),
        K::Insert => text(
            "byte = 3\nvalue = 0xEE",
            "1:00 2:0d 3:11 4:ee.13 5:81 6:05 7:06 8:07 9:08 10:09",
        ),
        K::Duplicate => text(
            "byte = 3",
            "1:00 2:0d 3:11 4:13.13 5:81 6:05 7:06 8:07 9:08 10:09",
        ),
        K::Burst => text(
            "byte = 3\nlen = 3\nvalue = 0xF0",
            "1:00 2:0d 3:11 4:e3 5:71 6:f5 7:06 8:07 9:08 10:09",
        ),
        K::Truncate => text("byte = 3\nlen = 3", "1:00 2:0d 3:11 7:06 8:07 9:08 10:09"),
        K::Swap => text(
            "byte = 3",
            "1:00 2:0d 3:11 5:81.13 6:05 7:06 8:07 9:08 10:09",
        ),
        K::ParityError => text(
            "byte = 3",
            "1:00 2:0d 3:11 4:!parityerror 5:81 6:05 7:06 8:07 9:08 10:09",
        ),
        K::Idle => text(
            "byte = 3\nby = \"1ms\"",
            "1:00 2:0d 3:11 14:13 15:81 16:05 17:06 18:07 19:08 20:09",
        ),
        _ => unreachable!("no damage to single bytes"),
    }
}

fn timing(kind: FaultKind) -> Row {
    use FaultKind as K;
    match kind {
        // Bytes 3 to 6 arrive in this time, and there is room for two.
        K::Overrun => text(
            "fifo = 2\nfrom = \"10300us\"\nuntil = \"10800us\"",
            "1:00 2:0d 3:11 8:13 8:81 8:!overrun 8:!overrun 8:07 9:08 10:09",
        ),
        // Pieces of four, four and two bytes: each arrives in pieces of three.
        K::ShortRead => Row {
            piece: 4,
            ..text("len = 3", "3:00.0d.11 4:13 7:81.05.06 8:07 10:08.09")
        },
        K::Latency => text(
            "by = \"1ms\"",
            "11:00 12:0d 13:11 14:13 15:81 16:05 17:06 18:07 19:08 20:09",
        ),
        K::Jitter => that("by = \"2ms\"", late_by_chance),
        K::Clog => that(
            "every = \"500us\"\nlasting = \"250us\"",
            held_back_in_the_spells_of_the_case,
        ),
        _ => unreachable!("no fault of timing"),
    }
}

/// Simultaneous deliveries are reported in the order of lines: the first line's first.
fn the_sender_hears_itself(seen: &Seen, _: &Seen) {
    assert_eq!(seen.line(0), PLAIN);
    let heard = "1:00 1:20 2:0d 2:2d 3:11 3:31 4:13 4:33 5:81 5:a1 6:05 6:25 7:06 7:26 8:07 8:27 \
                 9:08 9:28 10:09 10:29";
    assert_eq!(seen.line(1), heard);
}

/// The lines carry the same bytes; the receivers differ.
fn receivers_change_places(seen: &Seen, plain: &Seen) {
    assert_eq!(seen.lines, plain.lines);
    assert_eq!(
        seen.got[0],
        [0x00, 0x0D, 0x11, 0x53, 0xC1, 0x45, 0x46, 0x47, 8, 9]
    );
    assert_eq!(
        seen.got[2],
        [0x40, 0x4D, 0x51, 0x13, 0x81, 5, 6, 7, 0x48, 0x49]
    );
    assert_eq!([&seen.got[1], &seen.got[3]], [&plain.got[1], &plain.got[3]]);
}

/// At half the rate each bit of the sender is two of the receiver, and a character takes two byte
/// times. Of FF (low, then nine bits high) the receiver sees a start bit, then a low bit, then only
/// high ones: FE. Of 00 (nine bits low, then high) it sees eighteen low bits where the tenth should
/// be a stop bit: a framing error, and nothing else before the line goes low again.
fn half_the_rate(_: &Seen, _: &Seen) {
    let sent = [
        vec![0xFF, 0xFF, 0x00, 0xFF],
        vec![1; 4],
        vec![2; 4],
        vec![3; 4],
    ];
    let seen = run_each(one("wrong-baud", "baud = 50_000"), sent, 1);
    assert_eq!(seen.line(0), "2:fe 4:fe 6:!framing 8:fe");
    assert_eq!(seen.line(2), "1:02 2:02 3:02 4:02");
}

/// Arrival of each byte of the first line, in byte times.
fn times(seen: &Seen) -> Vec<f64> {
    let parts = seen.lines[0].iter();
    let time = |part: &String| part.split(':').next().expect("a time").parse();
    parts.map(|part| time(part).expect("a number")).collect()
}

/// All bytes arrive, in order, none early, none more than 20 byte times late. Some arrive together,
/// because a byte before them was late.
fn late_by_chance(seen: &Seen, plain: &Seen) {
    assert_eq!(seen.got, plain.got);
    let times = times(seen);
    let late: Vec<f64> = (1..)
        .zip(&times)
        .map(|(on, at)| at - f64::from(on))
        .collect();
    assert!(late.iter().all(|by| (0.0..=20.0).contains(by)), "{late:?}");
    assert!(late.iter().any(|by| *by > 1.0), "{late:?}");
    assert!(times.is_sorted());
    assert!(times.windows(2).any(|pair| pair[0] == pair[1]), "{times:?}");
}

/// The case contains the times at which the line was clogged. A byte from such a time arrives at
/// the end of that time.
fn held_back_in_the_spells_of_the_case(seen: &Seen, plain: &Seen) {
    assert_eq!(seen.got, plain.got);
    let spells: Vec<[f64; 2]> = seen.case.fault.iter().map(spell).collect();
    let inside = |at: f64| move |&[from, until]: &[f64; 2]| from < at && at < until;
    let hold = |at: f64| {
        let mut at = at;
        while let Some([_, until]) = spells.iter().copied().find(inside(at)) {
            at = until;
        }
        at
    };
    let expected: Vec<f64> = (1..=10_u8).map(|on| hold(f64::from(on))).collect();
    assert_eq!(times(seen), expected);
    assert_ne!(times(seen), times(plain), "no spell hit");
}

fn spell(stall: &hilrig::scenario::FaultSpec) -> [f64; 2] {
    assert_eq!(stall.kind, FaultKind::Stall);
    let window = stall.window();
    [window.from, window.until].map(|at| {
        let since = at.as_nanos() as f64 - Instant::from_millis(10).as_nanos() as f64;
        since / 1e5
    })
}

fn check(kind: FaultKind) {
    let Some(row) = row(kind) else {
        assert_ne!(kind.place(), FaultPlace::Line, "{} has no row", kind.name());
        return;
    };
    let fault = |keys: &str| run(one(kind.name(), keys), &SENT, row.piece);
    let (plain, seen) = (
        run(super::wire::scenario(""), &SENT, row.piece),
        fault(row.keys),
    );
    match row.sees {
        Sees::Text(text) => assert_eq!(seen.line(0), text, "{}", kind.name()),
        Sees::That(holds) => holds(&seen, &plain),
    }
    // A pulled plug also affects the other direction, until a client opens the port again.
    if ![FaultKind::Echo, FaultKind::Unplugged].contains(&kind) {
        assert_eq!(seen.others(0), plain.others(0), "{}", kind.name());
    }
    let none = fault(&never(kind, row.keys));
    assert_eq!((&none.lines, &none.got), (&plain.lines, &plain.got));
    assert_eq!(fault(row.keys), seen, "{} twice", kind.name());
    assert_again(&seen, row.piece);
}

/// The saved case repeats the run, and saves itself unchanged.
fn assert_again(seen: &Seen, piece: usize) {
    let parsed = Scenario::parse(Path::new("case.toml"), seen.case.to_toml());
    let again = run(parsed.expect("sound").0, &SENT, piece);
    assert_eq!((&again.lines, &again.got), (&seen.lines, &seen.got));
    assert_eq!(again.case.fault, seen.case.fault);
}

/// A fault does what its name says, and nothing else. Each kind of fault is visible at its target,
/// as often as it should be. A fault that never strikes leaves the wire unchanged. A second run
/// gives the same bytes, and so does the saved case; three other lines carry their usual bytes.
#[test]
fn each_kind_of_fault_is_seen_where_it_strikes_and_nowhere_else() {
    FaultKind::ALL.iter().copied().for_each(check);
}

/// With random damage, the bytes that the case names are those that differ. A fifth of 1000 is 200,
/// with a tolerance of four standard deviations (of 12.6).
#[test]
fn random_flips_are_where_the_case_says_they_were() {
    let sent: Vec<u8> = (0..1000_u32)
        .map(|n| u8::try_from(n % 100).expect("small"))
        .collect();
    let seen = run(one("flip", "rate = 0.2"), &sent, 1);
    assert_eq!(seen, run(one("flip", "rate = 0.2"), &sent, 1));
    let differ = (0_u64..).zip(sent.iter().zip(&seen.got[0]));
    let differ: Vec<u64> = differ
        .filter(|(_, (a, b))| a != b)
        .map(|(n, _)| n)
        .collect();
    let named: Vec<u64> = seen
        .case
        .fault
        .iter()
        .filter_map(|fault| fault.byte)
        .collect();
    assert_eq!(named, differ);
    assert!((150..=250).contains(&named.len()), "{}", named.len());
}

/// Each kind of random damage, on half of all bytes. Two runs agree, and the case that names the
/// bytes repeats the damage.
#[test]
fn damage_by_chance_comes_again_as_it_came() {
    for kind in FaultKind::ALL.iter().filter(|kind| kind.is_strike()) {
        let by = if *kind == FaultKind::Idle {
            "by = \"1ms\""
        } else {
            ""
        };
        let keys = format!("rate = 0.5\n{by}");
        let seen = run(one(kind.name(), &keys), &SENT, 1);
        assert_ne!(seen.line(0), PLAIN, "{}", kind.name());
        assert_eq!(run(one(kind.name(), &keys), &SENT, 1), seen);
        assert_again(&seen, 1);
    }
}

#[test]
fn each_kind_of_fault_is_explained() {
    let text = include_str!("../../../docs/faults.md");
    let explained = |kind: &FaultKind| text.contains(&format!("| `{}` |", kind.name()));
    let missing = FaultKind::ALL.iter().find(|kind| !explained(kind));
    assert_eq!(missing, None);
}
