//! Whether a program ignores damaged replies: it sends the same requests as without them.
//!
//! ```text
//!  with damage     A1  A2  A3  B4  C5      A three times, then B and C
//!  without damage  A1      A2  B3  C4      A twice, then B and C: the same
//! ```
//!
//! Requests are compared by their words, without numbers that count: a sequence number differs
//! in each repetition, and a checksum is no word. As soon as such a number differs between the
//! two runs, the recorded replies have the wrong number for one of them, and the program repeats
//! its requests for this reason: from there on only the order of the requests is compared.

use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet};

use protocols::Instant;

use super::Case;
use crate::divergence::Track;
use crate::replay::{Played, Recorded};
use engine::codec::{self, Codec, Stream, Stretch, What};
use engine::hex::pairs;
use engine::rig::line::Direction;
use engine::robots::{self, Dut, PcEnd};
use engine::run::check::Check;
use engine::scenario::Source;

/// Maximum pause between two pieces of one request.
const WITHIN: Duration = Duration::from_millis(20);
/// Largest number of repetitions that each damaged frame may cost: it may look like two frames.
const REPEATS: usize = 2;
/// Largest step of a number that counts: a program may skip some numbers after a lost reply.
const STEP_MAX: i128 = 16;
/// Smallest number of different requests with a number that counts.
const COUNTED_MIN: usize = 3;
/// Numbers of values after which a number that counts begins again: 8, 16 and 32 bits, or never.
const MODULI: [i128; 4] = [1 << 8, 1 << 16, 1 << 32, i128::MAX];

/// The damage of a link that was left out of a recording.
#[derive(Clone, Copy, Debug)]
pub struct LeftOut {
    /// Number of stretches of damaged bytes.
    pub count: u32,
    /// The protocol of the program's requests.
    pub requests: &'static Codec,
}

impl Case {
    /// Returns the recording without the damaged bytes to the program, and the number of their
    /// stretches on each link; links without damage are left out. Damaged bytes are those outside
    /// of valid frames of the link's protocol: the one of the case's scenario, which a description
    /// may define, or the one that the bytes prove.
    pub fn without_damage(
        &self,
        recorded: &Recorded,
        source: &Source,
    ) -> (Recorded, BTreeMap<String, LeftOut>) {
        let (mut sound, mut left_out) = (recorded.clone(), BTreeMap::new());
        let wired = self.scenario.as_ref().and_then(|scenario| {
            robots::wire(scenario, source, Dut::Internal, PcEnd::Scripted).ok()
        });
        let expected = |link: &str, direction: Direction| {
            let wired = wired.as_ref()?;
            let instruments = &wired.instruments;
            instruments.codec_towards(&wired.rig, link, direction)
        };
        for passage in &mut sound.links {
            let all: Vec<u8> = passage
                .arrivals
                .iter()
                .flat_map(|one| &one.bytes)
                .copied()
                .collect();
            let is_own = |codec: &&Codec| codec.framed_towards(&all, Direction::ToMaster) > 0;
            let own = expected(&passage.link, Direction::ToMaster).filter(is_own);
            let Some(codec) = own.or_else(|| codec::guess(&all)) else {
                continue;
            };
            let mut is_bad = vec![false; all.len()];
            for stretch in codec.found_towards(&all, Direction::ToMaster) {
                if matches!(stretch.what, What::Bad(_)) {
                    let range = usize::try_from(stretch.bytes.start).unwrap_or(usize::MAX)
                        ..usize::try_from(stretch.bytes.end).unwrap_or(usize::MAX);
                    is_bad[range].fill(true);
                }
            }
            let stretches = is_bad.chunk_by(|one, other| one == other);
            let stretches = stretches.filter(|stretch| stretch[0]).count();
            if let Some(count) = u32::try_from(stretches).ok().filter(|count| *count > 0) {
                let requests = expected(&passage.link, Direction::ToDevice).unwrap_or(codec);
                left_out.insert(passage.link.clone(), LeftOut { count, requests });
            }
            let mut place = 0;
            for arrival in &mut passage.arrivals {
                let own = &is_bad[place..place + arrival.bytes.len()];
                place += own.len();
                let mut flags = own.iter();
                arrival
                    .bytes
                    .retain(|_| !flags.next().is_some_and(|bad| *bad));
            }
            passage.arrivals.retain(|one| !one.bytes.is_empty());
        }
        (sound, left_out)
    }

    /// Whether a program ignores damage. It sent `damaged` with the damage and `sound` without: the
    /// requests must be equal, apart from numbers that count. A request may be repeated more often
    /// with the damage, by two repetitions for each damaged frame, but not less often. None may be
    /// later by more than `late`, and by one pause for each damaged frame of `left_out`. A program
    /// may pause after each reply, also after a damaged one, and repeat a missing one earlier.
    pub fn judge_damage(
        damaged: &[Played],
        sound: &[Played],
        left_out: &BTreeMap<String, LeftOut>,
        late: Duration,
    ) -> Vec<Check> {
        let pairs = damaged.iter().zip(sound);
        let checks = pairs.map(|(damaged, sound)| {
            let name = format!("ignores-damage-{}", damaged.link);
            let (got, expected) = (&damaged.got, &sound.got);
            if got.bytes().is_empty() && expected.bytes().is_empty() {
                return Check::not_observed(&name, "the program sent nothing");
            }
            let left_out = left_out.get(&damaged.link);
            let count = left_out.map_or(0, |one| one.count);
            let late = late.saturating_add(usual_pause(expected).saturating_mul(count));
            let codec = left_out.map(|one| one.requests);
            let [got, expected] = [got, expected].map(|track| Request::all(track, codec));
            let judged = compare(&got, &expected, (late, count));
            let detail = match &judged {
                Ok(words) | Err(words) => words.clone(),
            };
            Check::new(&name, judged.is_ok(), detail)
        });
        checks.collect()
    }
}

/// A request of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Request {
    /// Time of its last byte.
    at: Instant,
    words: String,
}

impl Request {
    /// The requests of `track`: frames of `codec`, and other bytes without a pause.
    fn all(track: &Track, codec: Option<&'static Codec>) -> Vec<Self> {
        let mut all = Vec::new();
        let mut stream = codec.map(|codec| Stream::towards(codec, Direction::ToDevice));
        let mut last = Instant::ZERO;
        let mut add = |found: Vec<Stretch>, at: Instant| {
            for stretch in found {
                let words = match stretch.what {
                    What::Frame(words) => words,
                    What::Bad(_) => {
                        let place = |at: u64| usize::try_from(at).unwrap_or(usize::MAX);
                        let range = place(stretch.bytes.start)..place(stretch.bytes.end);
                        pairs(track.bytes().get(range).unwrap_or_default())
                    }
                };
                all.push(Self { at, words });
            }
        };
        let mut plain: Vec<(Instant, Vec<u8>)> = Vec::new();
        for (at, bytes) in track.pieces() {
            let is_paused = at - last > WITHIN;
            match (&mut stream, plain.last_mut()) {
                (Some(stream), _) => {
                    if is_paused {
                        add(stream.idle(), last);
                    }
                    add(stream.push(bytes), at);
                }
                (None, Some((end, before))) if !is_paused => {
                    before.extend(bytes);
                    *end = at;
                }
                (None, _) => plain.push((at, bytes.to_vec())),
            }
            last = at;
        }
        if let Some(stream) = &mut stream {
            add(stream.idle(), last);
        }
        let plain = plain.into_iter().map(|(at, bytes)| Self {
            at,
            words: pairs(&bytes),
        });
        all.extend(plain);
        all
    }
}

/// Compares the requests with the damage and without it; returns the result as a sentence.
fn compare(
    got: &[Request],
    expected: &[Request],
    (late, damaged): (Duration, u32),
) -> Result<String, String> {
    let mut counting = counting(got);
    let also = self::counting(expected);
    counting.retain(|name| also.contains(name));
    let [got_rows, expected_rows] = [got, expected].map(|all| Row::all(all, &counting));
    let pairs = got_rows.iter().zip(&expected_rows);
    let last = got_rows.len().min(expected_rows.len()).saturating_sub(1);
    let (mut shifted, mut repeated, mut drifted) = (Duration::ZERO, 0, None);
    let repeats_max = REPEATS * usize::try_from(damaged).unwrap_or(usize::MAX / REPEATS);
    for (at, (got, expected)) in pairs.enumerate() {
        let (first, without) = (&got.requests[0], &expected.requests[0]);
        let (time, words) = (first.at, &first.words);
        if got.words != expected.words {
            return Err(format!(
                "the request at {time} s is \"{words}\", without the damage it is \"{}\"",
                without.words
            ));
        }
        // With other numbers, the recorded replies fit one of the two programs at most.
        if drifted.is_some() || first.words != without.words {
            drifted.get_or_insert(time);
            continue;
        }
        let [count, least] = [got.requests.len(), expected.requests.len()];
        let is_less = match counting.is_empty() {
            true => count < least,
            false => count == 1 && least > 1,
        };
        if is_less && at < last {
            return Err(format!(
                "the request at {time} s, \"{words}\", is sent {count} times, without the damage \
                 {least} times: a damaged reply was taken"
            ));
        }
        repeated += count.saturating_sub(least);
        if repeated > repeats_max && at < last {
            return Err(format!(
                "up to {time} s, {repeated} repetitions more than without the damage, limit \
                 {repeats_max}"
            ));
        }
        // An earlier request is no failure: the program waited for the missing frame.
        let both = got.requests.iter().zip(expected.requests);
        let same = both.take_while(|(got, expected)| got.words == expected.words);
        let shifts = same.map(|(got, expected)| got.at - expected.at);
        shifted = shifts.fold(shifted, Duration::max);
    }
    let (shift_s, late_s) = (shifted.as_secs_f64(), late.as_secs_f64());
    if shifted > late {
        return Err(format!(
            "up to {shift_s:.3} s later than without the damage, limit {late_s:.3} s"
        ));
    }
    let but = match counting.is_empty() {
        true => String::new(),
        false => {
            let names: Vec<&str> = counting.iter().map(String::as_str).collect();
            format!(", but for {}, which counts", names.join(", "))
        }
    };
    let count = got.len().min(expected.len());
    let until = drifted.map_or(String::new(), |at: Instant| {
        format!("; repetitions and times were compared up to {at} s, where a number differs")
    });
    Ok(format!(
        "the same {count} requests as without the damage{but}, {shift_s:.3} s later{until}"
    ))
}

/// A request and its repetitions.
struct Row<'a> {
    requests: &'a [Request],
    /// The words without numbers that count.
    words: String,
}

impl<'a> Row<'a> {
    fn all(requests: &'a [Request], counting: &BTreeSet<String>) -> Vec<Self> {
        let plain = |request: &Request| -> String {
            let words = tokens(&request.words).map(|token| match token.number {
                Some(_) if counting.contains(&token.name) => "#".to_owned(),
                _ => token.text.to_owned(),
            });
            words.collect()
        };
        let rows = requests.chunk_by(|one, other| plain(one) == plain(other));
        let row = |requests: &'a [Request]| Self {
            words: requests.first().map(plain).unwrap_or_default(),
            requests,
        };
        rows.map(row).collect()
    }
}

/// The names of the numbers that are greater in each request than in the one before it, by a small
/// step.
fn counting(requests: &[Request]) -> BTreeSet<String> {
    let mut values: BTreeMap<String, Vec<i128>> = BTreeMap::new();
    for request in requests {
        for token in tokens(&request.words) {
            if let Some(number) = token.number {
                values.entry(token.name).or_default().push(number);
            }
        }
    }
    let counts = |values: &[i128]| {
        let counts_to = |modulus: &i128| {
            let mut pairs = values.windows(2);
            values.iter().all(|value| value < modulus)
                && pairs.all(|pair| {
                    let step = (pair[1] - pair[0]).rem_euclid(*modulus);
                    (1..=STEP_MAX).contains(&step)
                })
        };
        values.len() >= COUNTED_MIN && MODULI.iter().any(counts_to)
    };
    let names = values.into_iter().filter(|(_, values)| counts(values));
    names.map(|(name, _)| name).collect()
}

/// A part of a request's words.
struct Token<'a> {
    text: &'a str,
    /// The value, if the part is a number.
    number: Option<i128>,
    /// The words before a number.
    name: String,
}

/// The words and whole numbers of `words`. The name of a number is the last word before it, with
/// its position if there are several.
fn tokens(words: &str) -> impl Iterator<Item = Token<'_>> {
    let is_digit = |c: char| c.is_ascii_digit();
    let (mut rest, mut name) = (words, String::new());
    core::iter::from_fn(move || {
        let first = rest.chars().next()?;
        let is_number = is_digit(first);
        let end = rest.find(|c: char| is_digit(c) != is_number);
        let (text, behind) = rest.split_at(end.unwrap_or(rest.len()));
        rest = behind;
        let number = text.parse().ok().filter(|_| is_number);
        if is_number {
            let of = name.clone();
            name.push('#');
            return Some(Token {
                text,
                number,
                name: of,
            });
        }
        let word = text.trim_matches(|c: char| !c.is_alphanumeric() && c != '_' && c != '.');
        match word.split_whitespace().last() {
            Some(last) => last.clone_into(&mut name),
            None => name.push('#'),
        }
        Some(Token {
            text,
            number: None,
            name: String::new(),
        })
    })
}

/// The median pause between two requests of a program: most of them follow a good reply.
fn usual_pause(sent: &Track) -> Duration {
    let times: Vec<Instant> = sent.pieces().map(|(at, _)| at).collect();
    let pauses = times.windows(2).map(|pair| pair[1] - pair[0]);
    let mut pauses: Vec<Duration> = pauses.filter(|pause| *pause > WITHIN).collect();
    pauses.sort_unstable();
    pauses.get(pauses.len() / 2).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use protocols::avr::{ChecksumOrder, Frame};

    use super::*;
    use crate::replay::{Arrival, Passage};
    use engine::run::check::Status;
    use engine::scenario::Scenario;

    const END: Instant = Instant::from_secs(10);

    /// Requests 100 ms apart.
    fn requests(words: &[&str]) -> Vec<Request> {
        let all = (1..).zip(words).map(|(number, words)| Request {
            at: Instant::from_millis(100 * number),
            words: (*words).to_owned(),
        });
        all.collect()
    }

    /// A retry has the next number in the first program, and the same number in the second one. A
    /// damaged reply costs one more repetition. A program that takes the damaged reply repeats
    /// less.
    #[test]
    fn a_repetition_with_another_number_is_the_same_request() {
        let late = Duration::from_millis(150);
        let holds = |got: &[&str], expected: &[&str]| {
            compare(&requests(got), &requests(expected), (late, 1)).is_ok()
        };
        let sound = [
            "a: tag 254, x 5",
            "a: tag 255, x 5",
            "b: tag 0",
            "a: tag 1, x 5",
        ];
        let more = [
            "a: tag 254, x 5",
            "a: tag 255, x 5",
            "a: tag 0, x 5",
            "b: tag 1",
            "a: tag 2, x 5",
        ];
        assert!(holds(&sound, &sound) && holds(&more, &sound));
        assert!(
            !holds(&["a: tag 254, x 5", "b: tag 255", "a: tag 0, x 5"], &sound),
            "taken"
        );
        let other = [
            "a: tag 254, x 5",
            "a: tag 255, x 9",
            "b: tag 0",
            "a: tag 1, x 5",
        ];
        assert!(!holds(&other, &sound), "another value");
        let spam = [&sound[..1], &["a: tag 255, x 5"; 9], &sound[2..]].concat();
        assert!(!holds(&spam, &sound), "too many repetitions");
        let same = ["a: tag 1", "a: tag 1", "a: tag 2", "a: tag 3"];
        let taken = ["a: tag 1", "a: tag 2", "a: tag 3", "a: tag 4"];
        assert!(holds(&same, &same) && !holds(&taken, &same));
    }

    /// Three register reads; in the second, a bit of the checksum is wrong.
    #[test]
    fn damage_is_what_is_in_no_frame() {
        let read = |register| Frame::read(register, 10, ChecksumOrder::LowFirst);
        let bytes = [36, 60, 36].map(|register| read(register).as_bytes().to_vec());
        let arrivals = (1..).zip(bytes).map(|(at, mut bytes)| {
            bytes[4] ^= u8::from(at == 2);
            let at = Instant::from_millis(at);
            Arrival { at, bytes }
        });
        let passage = Passage {
            arrivals: arrivals.collect(),
            ..Passage::default()
        };
        let recorded = Recorded {
            links: vec![passage],
            end: END,
            zero: Instant::ZERO,
        };
        let case = Case::of_outsider("x", &recorded, None);
        let text = "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"1s\"\n\
                    device.meter = { description = \"gps\" }\n";
        let (scenario, source) = Scenario::from_text(text).expect("sound");
        let (sound, left_out) = case.without_damage(&recorded, &source);
        assert_eq!(
            left_out
                .into_values()
                .map(|one| one.count)
                .collect::<Vec<_>>(),
            [1]
        );
        assert_eq!(sound.links[0].arrivals.len(), 2);

        // UBX of u-blox 8: class 1, message 2, no payload, and its checksum 03 0A. One poll is
        // damaged. Only the scenario tells the protocol of so few bytes.
        let polls = [0x0A, 0x0B, 0x0A].map(|last| vec![0xB5, 0x62, 1, 2, 0, 0, 3, last]);
        let arrivals = (1..).zip(polls).map(|(at, bytes)| Arrival {
            at: Instant::from_millis(at),
            bytes,
        });
        let passage = Passage {
            link: "meter".to_owned(),
            arrivals: arrivals.collect(),
            ..Passage::default()
        };
        let recorded = Recorded {
            links: vec![passage],
            end: END,
            zero: Instant::ZERO,
        };
        let case = Case::of_outsider("x", &recorded, Some(&scenario));
        let (sound, left_out) = case.without_damage(&recorded, &source);
        assert_eq!(
            left_out
                .into_values()
                .map(|one| one.count)
                .collect::<Vec<_>>(),
            [1]
        );
        assert_eq!(sound.links[0].arrivals.len(), 2);
    }

    /// A byte each half second. A program that sends 0.3 s later because of the damage, or sends
    /// another byte, does not ignore the damage.
    #[test]
    fn damage_is_ignored_if_nothing_is_other_or_later() {
        let played = |late_ms, byte| {
            let mut got = Track::default();
            for millis in (500..=2_000).step_by(500) {
                let is_late = if millis > 1_000 { late_ms } else { 0 };
                got.push(Instant::from_millis(millis + is_late), &[byte]);
            }
            [Played {
                link: "base".to_owned(),
                expected: Track::default(),
                got,
                talk: None,
            }]
        };
        let limit = Duration::from_millis(250);
        let judged = |late, byte, count| {
            let requests = &codec::BUS;
            let left_out = LeftOut { count, requests };
            let left_out = BTreeMap::from([("base".to_owned(), left_out)]);
            let checks = Case::judge_damage(&played(late, byte), &played(0, 1), &left_out, limit);
            checks[0].status
        };
        let judge = |late, byte| judged(late, byte, 0);
        assert_eq!((judge(0, 1), judge(250, 1)), (Status::Pass, Status::Pass));
        assert_eq!((judge(251, 1), judge(0, 2)), (Status::Fail, Status::Fail));
        // Two damaged frames may cost two of the usual pauses of 500 ms.
        let paced = [judged(1_250, 1, 2), judged(1_251, 1, 2), judged(0, 2, 2)];
        assert_eq!(paced, [Status::Pass, Status::Fail, Status::Fail]);
    }

    /// Chunks at these milliseconds.
    fn track(millis: &[u64]) -> Track {
        let mut track = Track::default();
        for at in millis {
            track.push(Instant::from_millis(*at), b"a");
        }
        track
    }

    /// The median of the pauses of more than 20 ms: of 100, 200, 300 and 400 ms the third one.
    #[test]
    fn the_usual_pause_is_the_median() {
        let of = |millis: &[u64]| usual_pause(&track(millis)).as_millis();
        assert_eq!(of(&[0, 100, 300, 600, 1_000]), 300);
        assert_eq!(of(&[0, 20, 40, 140]), 100);
        assert_eq!(of(&[0, 21]), 21);
        assert_eq!((of(&[0, 20]), of(&[])), (0, 0));
    }

    /// Bytes with a pause of 20 ms at most are one request, with and without a known protocol.
    #[test]
    fn a_request_may_come_in_two_pieces() {
        let words = |millis: &[u64]| -> Vec<(u64, String)> {
            let all = Request::all(&track(millis), None).into_iter();
            all.map(|one| (one.at.as_millis(), one.words)).collect()
        };
        assert_eq!(words(&[10, 30]), [(30, "61 61".to_owned())]);
        let apart = [(10, "61".to_owned()), (31, "61".to_owned())];
        assert_eq!(words(&[10, 31]), apart);
        let frame = Frame::read(36, 10, ChecksumOrder::LowFirst);
        let (begin, rest) = frame.as_bytes().split_at(2);
        let count = |second: u64| {
            let mut track = Track::default();
            track.push(Instant::from_millis(10), begin);
            track.push(Instant::from_millis(second), rest);
            Request::all(&track, Some(&codec::BUS)).len()
        };
        assert_eq!(count(30), 1);
        assert!(count(31) > 1);
    }

    /// Each damaged reply may cost two repetitions, in all requests but the last one together.
    #[test]
    fn repetitions_are_added_up() {
        let holds = |got: &str, expected: &str, damaged| {
            let requests = |text: &str| {
                let all: Vec<&str> = text.split(' ').collect();
                requests(&all)
            };
            let late = Duration::from_secs(60);
            compare(&requests(got), &requests(expected), (late, damaged)).is_ok()
        };
        assert!(holds("a a a b c", "a b c", 1) && !holds("a a a a b c", "a b c", 1));
        assert!(!holds("a a a b b c", "a b c", 1) && holds("a a b b c", "a b c", 1));
        assert!(holds("a a a a a a a b c", "a b c", 3));
        assert!(!holds("a a a a a a a a b c", "a b c", 3));
        assert!(holds("a b c c c c", "a b c", 1));
        assert!(!holds("a b c", "a a b c", 1) && holds("a b c", "a b c c", 1));
    }

    /// The name of a number is the last word before it, with its marks inside.
    #[test]
    fn a_number_has_the_name_before_it() {
        let names = |words: &str| -> Vec<(String, i128)> {
            let numbers = tokens(words).filter_map(|one| Some((one.name, one.number?)));
            numbers.collect()
        };
        let of = |list: &[(&str, i128)]| {
            let owned = list
                .iter()
                .map(|(name, number)| ((*name).to_owned(), *number));
            owned.collect::<Vec<_>>()
        };
        assert_eq!(names("read _a.b_: 5"), of(&[("_a.b_", 5)]));
        assert_eq!(names("x 1, 2 y (3)"), of(&[("x", 1), ("x##", 2), ("y", 3)]));
        assert_eq!(names("7"), of(&[("", 7)]));
    }

    /// Three numbers or more, each 1 to 16 greater than the one before it. After 255, and the
    /// largest numbers of 16 and 32 bits, 0 follows; 256 is no number of eight bits.
    #[test]
    fn a_number_counts_in_small_steps() {
        let counts = |numbers: &[u64]| {
            let words: Vec<String> = numbers.iter().map(|n| format!("tag {n}, x 5")).collect();
            let words: Vec<&str> = words.iter().map(String::as_str).collect();
            let found = counting(&requests(&words));
            let names: Vec<&str> = found.iter().map(String::as_str).collect();
            assert!(matches!(names[..], [] | ["tag"]), "{names:?}");
            !found.is_empty()
        };
        assert!(counts(&[1, 2, 3]) && !counts(&[1, 2]));
        assert!(counts(&[1, 17, 18]) && !counts(&[1, 18, 19]));
        assert!(!counts(&[1, 2, 2]) && !counts(&[3, 2, 1]));
        assert!(counts(&[254, 255, 0]) && !counts(&[254, 255, 256, 1]));
        assert!(counts(&[65_535, 0, 1]) && counts(&[u64::from(u32::MAX), 0, 1]));
        assert!(!counts(&[65_536, 0, 1]) && counts(&[1 << 32, (1 << 32) + 1, (1 << 32) + 9]));
    }

    /// A program that is silent in one of both runs does not ignore the damage; silence in both of
    /// them shows nothing.
    #[test]
    fn a_silent_program_is_not_observed() {
        let judged = |got: &[u64], expected: &[u64]| {
            let [got, expected] = [got, expected].map(|millis| {
                [Played {
                    link: "base".to_owned(),
                    expected: Track::default(),
                    got: track(millis),
                    talk: None,
                }]
            });
            let late = Duration::from_millis(250);
            let checks = Case::judge_damage(&got, &expected, &BTreeMap::new(), late);
            (checks[0].name.clone(), checks[0].status)
        };
        let name = "ignores-damage-base".to_owned();
        assert_eq!(judged(&[], &[]), (name, Status::NotObserved));
        assert_ne!(judged(&[500], &[]).1, Status::NotObserved);
        assert_ne!(judged(&[], &[500]).1, Status::NotObserved);
    }

    /// The scenario has a GPS receiver, but the bytes of the link are reads of registers: they show
    /// another protocol, whose one damaged frame counts.
    #[test]
    fn a_protocol_without_a_frame_is_not_that_of_the_link() {
        let frames = [36, 60, 36].map(|register| {
            let frame = Frame::read(register, 10, ChecksumOrder::LowFirst);
            frame.as_bytes().to_vec()
        });
        let arrivals = (1..).zip(frames).map(|(at, mut bytes)| {
            bytes[4] ^= u8::from(at == 2);
            let at = Instant::from_millis(at);
            Arrival { at, bytes }
        });
        let recorded = Recorded {
            links: vec![Passage {
                link: "meter".to_owned(),
                arrivals: arrivals.collect(),
                ..Passage::default()
            }],
            end: END,
            zero: Instant::ZERO,
        };
        let text = "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"1s\"\n\
                    device.meter = { description = \"gps\" }\n";
        let (scenario, source) = Scenario::from_text(text).expect("sound");
        let case = Case::of_outsider("x", &recorded, Some(&scenario));
        let (sound, left_out) = case.without_damage(&recorded, &source);
        assert_eq!(left_out["meter"].count, 1);
        assert_eq!(sound.links[0].arrivals.len(), 2);
    }
}
