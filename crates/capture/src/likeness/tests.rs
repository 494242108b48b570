//! Conversations by hand. A byte takes 10 us at 1 Mbaud.

use std::collections::VecDeque;

use emulators::figure::Limit;
use protocols::LineConfig;

use super::talk::Exchange;
use super::*;
use crate::replay::Arrival;

const LINE: LineConfig = LineConfig::new_8n1(1_000_000);

fn us(micros: u64) -> Instant {
    Instant::from_micros(micros)
}

fn arrivals(list: &[(u64, &[u8])]) -> Vec<Arrival> {
    let arrival = |&(at, bytes): &(u64, &[u8])| Arrival {
        at: us(at),
        bytes: bytes.to_vec(),
    };
    list.iter().map(arrival).collect()
}

/// Bytes to the device and from it, by the microsecond at which the last one is complete.
fn passage(heard: &[(u64, &[u8])], said: &[(u64, &[u8])]) -> Passage {
    Passage {
        link: "port".to_owned(),
        baud: LINE.baud,
        heard: arrivals(heard),
        arrivals: arrivals(said),
        ..Passage::default()
    }
}

fn burst(start: u64, bytes: &[u8]) -> Burst {
    let end = start + 10 * bytes.len() as u64;
    Burst {
        start: us(start),
        end: us(end),
        bytes: bytes.to_vec(),
    }
}

/// Bytes at a microsecond.
type At<'a> = (u64, &'a [u8]);
/// A request by its end, and its reply by its start.
type Asked<'a> = (u64, &'a [u8], Option<At<'a>>);

fn talk(exchanges: &[Asked<'_>], unasked: &[At<'_>]) -> Talk {
    let exchange = |&(end, request, reply): &Asked<'_>| Exchange {
        request: request.to_vec(),
        end: us(end),
        reply: reply.map(|(start, bytes)| burst(start, bytes)),
    };
    Talk {
        exchanges: exchanges.iter().map(exchange).collect(),
        unasked: unasked
            .iter()
            .map(|&(start, bytes)| burst(start, bytes))
            .collect(),
    }
}

/// A device that begins with a reply some time after each request has ended, and sends its planned
/// bytes by itself.
struct Answers {
    now: Instant,
    latency: Duration,
    reply: Vec<u8>,
    planned: VecDeque<(Instant, Vec<u8>)>,
    heard: Vec<(Instant, Vec<u8>)>,
}

impl Answers {
    fn new(latency_us: u64, reply: &[u8]) -> Self {
        Self {
            now: Instant::ZERO,
            latency: Duration::from_micros(latency_us),
            reply: reply.to_vec(),
            planned: VecDeque::new(),
            heard: Vec::new(),
        }
    }
}

impl Peer for Answers {
    fn now(&self) -> Instant {
        self.now
    }

    fn send(&mut self, bytes: &[u8]) -> Result<Instant, String> {
        let end = self.now + LINE.bytes_time(bytes.len() as u64);
        self.heard.push((self.now, bytes.to_vec()));
        if !self.reply.is_empty() {
            self.planned
                .push_back((end + self.latency, self.reply.clone()));
            self.planned.make_contiguous().sort();
        }
        Ok(end)
    }

    fn hear(&mut self, until: Instant) -> Result<Option<(Instant, Vec<u8>)>, String> {
        match self.planned.front() {
            Some(&(at, _)) if at < until => {
                self.now = self.now.max(at);
                Ok(self.planned.pop_front())
            }
            _ => {
                self.now = self.now.max(until);
                Ok(None)
            }
        }
    }
}

/// Bytes with less than 20 ms between them are one burst. The first burst after a request is its
/// reply; a clock that rounds may show it up to a millisecond before the request has ended.
#[test]
fn bursts_belong_to_the_request_before_them() {
    let requests = [(10_000, &b"a"[..]), (90_000, b"b"), (150_000, b"c")];
    let heard: Vec<(u64, &[u8])> = requests.to_vec();
    let said: [(u64, &[u8]); 7] = [
        (5_010, b"0"),
        // 2 ms after the request, then 19.99 ms later, then 20 ms later.
        (12_010, b"1"),
        (32_010, b"2"),
        (52_020, b"3"),
        // 0.99 ms before the second request ends, with two bytes.
        (89_030, b"45"),
        // 2 ms before the third one.
        (148_010, b"6"),
        (148_020, b"7"),
    ];
    let found = Talk::captured(&passage(&heard, &said));
    let expected = talk(
        &[
            (10_000, b"a", Some((12_000, b"1"))),
            (90_000, b"b", Some((89_010, b"45"))),
            (150_000, b"c", None),
        ],
        &[(5_000, b"0"), (52_010, b"3"), (148_000, b"67")],
    );
    let mut expected = expected;
    expected.exchanges[0].reply = Some(Burst {
        start: us(12_000),
        end: us(32_010),
        bytes: b"12".to_vec(),
    });
    assert_eq!(found, expected);
}

/// Bytes to the device with less than 20 ms between them are one request, unless the device has
/// sent something in between.
#[test]
fn requests_end_with_a_pause_or_an_answer() {
    let requests = |heard: &[(u64, &[u8])], said: &[(u64, &[u8])]| -> Vec<(u64, Vec<u8>)> {
        let found = Talk::captured(&passage(heard, said)).exchanges;
        let found = found.into_iter();
        found
            .map(|one| (one.end.as_micros(), one.request))
            .collect()
    };
    let two: [(u64, &[u8]); 2] = [(10_000, b"ab"), (30_009, b"c")];
    assert_eq!(requests(&two, &[]), [(30_009, b"abc".to_vec())]);
    let later: [(u64, &[u8]); 2] = [(10_000, b"ab"), (30_010, b"c")];
    let apart = [(10_000, b"ab".to_vec()), (30_010, b"c".to_vec())];
    assert_eq!(requests(&later, &[]), apart);
    let apart = [(10_000, b"ab".to_vec()), (30_009, b"c".to_vec())];
    assert_eq!(requests(&two, &[(20_000, b"x")]), apart);
    assert_eq!(requests(&two, &[(10_000, b"x"), (30_000, b"y")]).len(), 1);
}

/// The log has the time of the first byte: a reply of 200 bytes, 2 ms long, does not begin before
/// its request.
#[test]
fn a_reply_does_not_begin_before_its_request() {
    let found = Talk::captured(&passage(&[(10_000, b"a")], &[(10_500, &[7; 200])]));
    let reply = found.exchanges[0].reply.as_ref().expect("it is one");
    assert_eq!((reply.start, reply.bytes.len()), (us(10_000), 200));
    assert_eq!(found.latencies_ms(), [0.0]);
}

/// Figures of a conversation by hand: latencies of 2 and 5 ms; bursts begin at 100, 200, 300 and
/// 420 ms, and a request ends at 250 ms, between the second and the third of them.
#[test]
fn figures_of_a_conversation_by_hand() {
    let one = talk(
        &[
            (10_000, b"a", Some((12_000, b"xyz"))),
            (50_000, b"a", Some((55_000, b"xy"))),
            (250_000, b"b", None),
        ],
        &[
            (100_000, b"1234"),
            (200_000, b"12"),
            (300_000, b"12"),
            (420_000, b"1234"),
        ],
    );
    assert_eq!(one.latencies_ms(), [2.0, 5.0]);
    assert_eq!(one.periods_ms(), [100.0, 120.0]);
    assert_eq!(one.burst_lengths(), [4.0, 2.0, 2.0, 4.0]);
    // The rate is that of 17 bytes, the last of which ends at 420.04 ms.
    let rate = one.bytes_per_s().expect("there are bytes");
    assert!((rate - 17.0 / 0.42004).abs() < 1e-9, "{rate}");
    let messages: Vec<(&[u8], &[u8])> = one.messages().collect();
    assert_eq!(
        messages[..3],
        [(&b"a"[..], &b"xyz"[..]), (b"a", b"xy"), (b"", b"1234")]
    );
    assert_eq!(messages.len(), 6);
    assert_eq!(replied(&one), Some(100.0 * 2.0 / 3.0));
    let quiet = talk(&[(10_000, b"a", None)], &[]);
    assert_eq!((quiet.bytes_per_s(), replied(&quiet)), (None, Some(0.0)));
    assert_eq!(replied(&Talk::default()), None);
    assert_eq!(Talk::default().bytes_per_s(), None);
}

/// A request that ends less than 20 ms after a burst may have cut it off. A burst of 20,000 bytes
/// lasts 200 ms.
#[test]
fn a_burst_is_cut_by_a_request_and_long_ones_are_streams() {
    let reply = |next: u64| {
        let one = talk(
            &[(10_000, b"a", Some((12_000, b"x"))), (next, b"a", None)],
            &[],
        );
        one.is_cut(one.exchanges[0].reply.as_ref().expect("it is one"))
    };
    assert_eq!([20_000, 32_009, 32_010].map(reply), [true, true, false]);
    let alone = talk(&[(10_000, b"a", Some((12_000, b"x")))], &[]);
    assert!(!alone.is_cut(alone.exchanges[0].reply.as_ref().expect("it is one")));
    let long = vec![0; 20_000];
    let time = Duration::from_millis(200);
    assert!(talk(&[], &[(0, &long)]).has_stream(time));
    assert!(!talk(&[], &[(0, &long[1..])]).has_stream(time));
    assert!(talk(&[(10, b"a", Some((20, &long)))], &[]).has_stream(time));
    assert!(!Talk::default().has_stream(time));
}

/// The peer has run for 3 s when the conversation begins, 2 s later. It gets each request at the
/// time at which its first byte was sent, and replies 4 ms after the last one.
#[test]
fn requests_are_played_at_their_times() {
    let real = talk(
        &[
            (10_000, b"ab", Some((12_000, b"xyz"))),
            (500_000, b"c", None),
        ],
        &[],
    );
    let mut peer = Answers::new(4_000, b"xy");
    peer.now = Instant::from_secs(3);
    // Before the beginning, at it, and later than half a second after the last request.
    for micros in [4_999_990, 5_000_000, 6_100_000] {
        peer.planned.push_back((us(micros), b"u".to_vec()));
    }
    let ours = Talk::played(&real, LINE, &mut peer, WARM_UP).expect("it is there");
    let zero = 5_000_000;
    let expected = [
        (zero + 9_980, b"ab".to_vec()),
        (zero + 499_990, b"c".to_vec()),
    ];
    assert_eq!(peer.heard, expected.map(|(at, bytes)| (us(at), bytes)));
    let expected = talk(
        &[
            (10_000, b"ab", Some((14_000, b"xy"))),
            (500_000, b"c", Some((504_000, b"xy"))),
        ],
        &[(0, b"u")],
    );
    assert_eq!(ours, expected);
}

/// A device that sends by itself to the end of the capture is compared up to there, and not half a
/// second longer.
#[test]
fn a_device_that_sends_by_itself_is_compared_over_the_same_time() {
    let count = |last: u64, request: u64| {
        let real = talk(&[(request, b"a", None)], &[(last, b"u")]);
        let mut peer = Answers::new(0, b"");
        for number in 0..40 {
            peer.planned
                .push_back((us(2_000_000 + number * 100_000), b"u".to_vec()));
        }
        let ours = Talk::played(&real, LINE, &mut peer, WARM_UP).expect("it is there");
        let replies = ours.exchanges.iter().filter(|one| one.reply.is_some());
        ours.unasked.len() + replies.count()
    };
    // The last burst ends at 1000.01 ms: 0, 100 .. 1000 ms are eleven bursts.
    assert_eq!(count(1_000_000, 50_000), 11);
    // The last request ends at 1050 ms: up to 1550 ms there are 16.
    assert_eq!(count(1_000_000, 1_050_000), 16);
}

fn figure<'a>(likeness: &'a Likeness, name: &str) -> &'a Comparison {
    let mut figures = likeness.figures.iter();
    figures.find(|one| one.name == name).expect("it is listed")
}

/// Six requests, 100 ms apart, each answered 10 ms later by three bytes, of which the first two
/// never change.
fn asked() -> Passage {
    let replies: Vec<[u8; 3]> = (1..=6).map(|number| [0xA5, 0x5A, number]).collect();
    let heard: Vec<(u64, &[u8])> = (1..=6).map(|n| (n * 100_000, &b"?"[..])).collect();
    let said: Vec<(u64, &[u8])> = (1..)
        .zip(&replies)
        .map(|(n, reply)| (n * 100_000 + 10_030, &reply[..]))
        .collect();
    passage(&heard, &said)
}

/// A device with 13 ms of latency instead of 10, a second constant byte of 5B, and the right
/// length. A fifth of 10 ms is 2 ms; with 3 ms of slack it agrees.
#[test]
fn replies_are_compared_by_length_latency_and_constant_bytes() {
    let compared = |slack_ms| {
        let mut peer = Answers::new(13_000, &[0xA5, 0x5B, 9]);
        compare(&asked(), &mut peer, Duration::from_millis(slack_ms)).expect("it is there")
    };
    let found = compared(1);
    let shown = |name| {
        let one = figure(&found, name);
        (one.real, one.ours, one.holds())
    };
    assert_eq!(shown("requests"), (Some(6.0), Some(6.0), None));
    assert_eq!(
        shown("requests with a reply"),
        (Some(100.0), Some(100.0), Some(true))
    );
    let all = (Some(100.0), Some(100.0), Some(true));
    assert_eq!(shown("replies of the captured length"), all);
    // Of the two constant bytes, the first is alike.
    assert_eq!(
        shown("constant bytes alike"),
        (Some(100.0), Some(50.0), None)
    );
    for name in ["latency, 10 %", "latency, median", "latency, 90 %"] {
        let one = figure(&found, name);
        assert!((one.real.expect("replies") - 10.0).abs() < 1e-9, "{one:?}");
        assert!((one.ours.expect("replies") - 13.0).abs() < 1e-9, "{one:?}");
        assert_eq!((one.limit, one.holds()), (Limit::Plus(2.0), Some(false)));
    }
    assert_eq!(
        found.constants,
        ["replies to 3F: byte 1 is 5A, emulated 5B"]
    );
    assert!(!found.holds() && compared(3).holds());
    // Of a conversation with requests only, the rate is that of the requests.
    let rate = figure(&found, "bytes from the device per second");
    assert_eq!(rate.limit, Limit::Free);
    assert_eq!(
        figure(&found, "bursts without a request").limit,
        Limit::Free
    );
}

/// Replies of two bytes instead of three, and none at all.
#[test]
fn a_wrong_length_and_silence_differ() {
    let compared = |reply: &[u8]| {
        let mut peer = Answers::new(10_000, reply);
        compare(&asked(), &mut peer, Duration::from_millis(20)).expect("it is there")
    };
    let found = compared(&[0xA5, 0x5A]);
    let lengths = figure(&found, "replies of the captured length");
    assert_eq!((lengths.real, lengths.ours), (Some(100.0), Some(0.0)));
    assert!(!found.holds() && found.constants.is_empty());
    let silent = compared(b"");
    let replied = figure(&silent, "requests with a reply");
    assert_eq!((replied.real, replied.ours), (Some(100.0), Some(0.0)));
    assert!(!silent.holds());
    assert!(!Likeness::default().holds(), "nothing was judged");
}

/// Bursts of four bytes each 100 ms. With five of them their figures are judged, with four they
/// are not.
#[test]
fn bursts_are_compared_by_number_length_and_period() {
    let compared = |count: u64, period: u64, len: usize| {
        let said: Vec<(u64, &[u8])> = (0..count)
            .map(|n| (n * 100_000 + 40, &b"\x55abc"[..]))
            .collect();
        let mut peer = Answers::new(0, b"");
        for number in 0..count {
            let bytes = b"\x55abcdefgh"[..len].to_vec();
            peer.planned
                .push_back((us(2_000_000 + number * period), bytes));
        }
        compare(&passage(&[], &said), &mut peer, Duration::from_millis(1)).expect("it is there")
    };
    let same = compared(5, 100_000, 4);
    let limits = [
        ("bursts without a request", Limit::Plus(0.5), 5.0),
        ("bytes of a burst, median", Limit::Share(0.1), 4.0),
        ("period of bursts, median", Limit::Plus(5.0), 100.0),
        ("period of bursts, 10 to 90 %", Limit::Plus(1.0), 0.0),
    ];
    for (name, limit, value) in limits {
        let one = figure(&same, name);
        assert_eq!(
            (one.limit, one.real, one.ours),
            (limit, Some(value), Some(value)),
            "{name}"
        );
    }
    // The rate is that of 20 bytes in 400.04 ms.
    let rate = figure(&same, "bytes from the device per second");
    assert_eq!(rate.limit, Limit::Share(0.1));
    assert!((rate.real.expect("bytes") - 20.0 / 0.40004).abs() < 1e-9);
    assert!(same.holds());
    assert!(!compared(5, 90_000, 4).holds(), "another period");
    assert!(!compared(5, 100_000, 5).holds(), "another length");
    let few = compared(4, 100_000, 4);
    assert_eq!(figure(&few, "bursts without a request").limit, Limit::Free);
    assert_eq!(figure(&few, "period of bursts, median").limit, Limit::Free);
}

/// Of 25 bursts among requests, a tenth and their root, 2.5 + 5, may be replies by chance.
#[test]
fn bursts_among_requests_may_be_taken_for_replies() {
    let unasked: Vec<(u64, &[u8])> = (0..25).map(|n| (n * 100_000, &b"u"[..])).collect();
    let real = talk(&[(3_000_000, b"?", None)], &unasked);
    let rows = figures(&real, &real, Duration::ZERO);
    let bursts = rows
        .iter()
        .find(|row| row.name == "bursts without a request");
    assert_eq!(bursts.expect("listed").limit, Limit::Plus(7.5));
}

/// Four messages to one request: bytes 0 and 2 are constant. The other request has two replies,
/// too few. At most eight bytes are named.
#[test]
fn constant_bytes_need_three_messages_of_a_kind() {
    let exchanges = |replies: &[(&'static [u8], &'static [u8])]| {
        let list: Vec<_> = (1..)
            .zip(replies)
            .map(|(n, &(request, reply))| (n * 1_000_000, request, Some((n * 1_000_000, reply))))
            .collect();
        talk(&list, &[])
    };
    let real = exchanges(&[
        (b"v", b"A1B"),
        (b"v", b"A2B"),
        (b"w", b"Q"),
        (b"v", b"A3B"),
        (b"w", b"Q"),
    ]);
    let ours = exchanges(&[
        (b"v", b"A1C"),
        (b"v", b"A2B"),
        (b"w", b"R"),
        (b"v", b"X3C"),
        (b"w", b"R"),
    ]);
    // Six bytes: A, A, X and C, B, C, of which three are alike.
    assert_eq!(constant_share(&real, &ours), [Some(100.0), Some(50.0)]);
    let expected = [
        "replies to 76: byte 0 is 41, emulated 58",
        "replies to 76: byte 2 is 42, emulated 43",
    ];
    assert_eq!(constants(&real, &ours), expected);
    assert_eq!(constant_share(&real, &Talk::default()), [None, None]);

    let bursts =
        |bytes: &'static [u8]| talk(&[], &[(0, bytes), (100_000, bytes), (200_000, bytes)]);
    let named = |len: usize| constants(&bursts(&[1; 12][..len]), &bursts(&[2; 12][..len]));
    assert_eq!(
        named(1),
        ["bursts without a request: byte 0 is 01, emulated 02"]
    );
    assert_eq!(named(8).len(), 8);
    assert_eq!((named(10).len(), &*named(10)[8]), (9, "and 2 more"));
}

/// Replies that a request may have cut off, and those of 200 ms or more, are not compared by their
/// length.
#[test]
fn only_whole_replies_are_compared_by_length() {
    let long = vec![0; 20_000];
    let real = talk(
        &[
            (0, b"?", Some((1_000, b"abc"))),
            (500_000, b"?", Some((501_000, &long))),
            (1_000_000, b"?", Some((1_001_000, b"abc"))),
            (1_010_000, b"?", Some((1_011_000, b"ab"))),
        ],
        &[],
    );
    let mut ours = real.clone();
    assert_eq!(lengths(&real, &ours), [Some(100.0), Some(100.0)]);
    for exchange in &mut ours.exchanges {
        exchange.reply = Some(burst(0, b"abc"));
    }
    // The first is alike, the last is not; the others do not count.
    assert_eq!(lengths(&real, &ours), [Some(100.0), Some(50.0)]);
    assert_eq!(lengths(&real, &Talk::default()), [None, None]);
}

/// Of the values 1 to 11, the lowest, the second, the middle one and the highest.
#[test]
fn quantiles_are_values_of_the_list() {
    let values: Vec<f64> = (1..=11).rev().map(f64::from).collect();
    let at = [0.0, 0.1, 0.5, 1.0].map(|quantile| at_quantile(values.clone(), quantile));
    assert_eq!(at, [1.0, 2.0, 6.0, 11.0].map(Some));
    assert_eq!(at_quantile(vec![], 0.5), None);
    assert_eq!(
        (some(0), some(3), percent(1, 4), percent(0, 0)),
        (None, Some(3.0), Some(25.0), None)
    );
    assert_eq!(ms(us(1_500), us(4_000)), 2.5);
}

/// The rate of the device is its own if it sends by itself, without requests, or in streams.
#[test]
fn the_rate_of_a_device_that_sends_by_itself_is_judged() {
    let limit = |real: &Talk| {
        let rows = figures(real, real, Duration::ZERO);
        let rate = rows
            .iter()
            .find(|row| row.name.starts_with("bytes from the device"));
        rate.expect("listed").limit
    };
    let asked: [Asked<'_>; 1] = [(10_000, b"?", Some((12_000, b"x")))];
    let bursts: Vec<At<'_>> = (1..=5).map(|n| (n * 100_000, &b"u"[..])).collect();
    assert_eq!(limit(&talk(&asked, &[])), Limit::Free);
    assert_eq!(limit(&talk(&asked, &bursts[..4])), Limit::Free);
    assert_eq!(limit(&talk(&asked, &bursts)), Limit::Share(0.1));
    assert_eq!(limit(&talk(&[], &bursts[..1])), Limit::Share(0.1));
    let long = vec![0; 20_000];
    let stream: [Asked<'_>; 1] = [(10_000, b"?", Some((12_000, &long)))];
    assert_eq!(limit(&talk(&stream, &[])), Limit::Share(0.1));
}

/// Bursts at 10, 30 and 60 ms. A request that ends with the beginning of the second one is not
/// between the first two.
#[test]
fn a_request_at_the_start_of_a_burst_is_behind_the_burst_before() {
    let bursts: [At<'_>; 3] = [(10_000, b"a"), (30_000, b"b"), (60_000, b"c")];
    let periods = |end: u64| talk(&[(end, b"?", None)], &bursts).periods_ms();
    assert_eq!((periods(30_000), periods(29_999)), (vec![20.0], vec![30.0]));
    assert_eq!(periods(5_000), [20.0, 30.0]);
    assert_eq!(periods(60_000), [20.0, 30.0]);
}
