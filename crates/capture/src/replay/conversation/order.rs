//! Order of the bytes of a conversation: records closer together than their bytes, and answers
//! beside unsolicited frames.

use super::*;
use crate::divergence::Track;
use crate::replay::Arrival;
use protocols::LineConfig;

fn ms(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

const ASK: &[u8] = b"~\x12\x01\x05~";
const ANSWER: &[u8] = b"~\x93\x05No 7\x51\x03~";
/// Time from the end of the request to the end of the answer in every capture.
const DELAY: Duration = Duration::from_millis(30);

/// Status frame `number` of a device with flags at both ends.
fn status(number: u8) -> Vec<u8> {
    let mut frame = b"~\x90\x0a?\x00\x00\x00\x00B\xfd\x17\xdc\x00\xee\x16~".to_vec();
    frame[3] = number + 1;
    frame
}

/// The division of bytes into records.
#[derive(Clone, Copy, Debug)]
enum Records {
    /// A frame each.
    Whole,
    /// A byte each, at its time.
    Bytes,
    /// Three bytes each; every second record 42 us after the one before it.
    Close,
    /// Five bytes each, at the next millisecond: those of a USB adapter.
    Frames,
    /// Seven bytes each; the recorder paused for 5 ms in the frames 4 and 9.
    Paused,
}

/// The records of `bytes`, of which the last is complete at `end`.
fn records(records: Records, line: LineConfig, end: Instant, bytes: &[u8]) -> Vec<Arrival> {
    let size = match records {
        Records::Whole => bytes.len(),
        Records::Bytes => 1,
        Records::Close => 3,
        Records::Frames => 5,
        Records::Paused => 7,
    };
    let mut list: Vec<Arrival> = Vec::new();
    let mut behind = bytes.len();
    for (index, chunk) in bytes.chunks(size).enumerate() {
        behind -= chunk.len();
        let own = line.byte_end(end, behind as u64);
        let before = list.last().map_or(own, |last| last.at);
        let at = match records {
            Records::Close if index % 2 == 1 => before + Duration::from_micros(42),
            Records::Frames => Instant::from_millis(own.as_nanos().div_ceil(1_000_000)),
            Records::Paused if index > 0 && matches!(bytes[3], 5 | 10) => {
                own + Duration::from_millis(5)
            }
            _ => own,
        };
        let bytes = chunk.to_vec();
        let at = at.max(before);
        list.push(Arrival { at, bytes });
    }
    list
}

/// A capture of 12 status frames, 100 ms apart, and of one request at `asked`.
fn captured(baud: u32, how: Records, asked: Instant, opened: &[Instant]) -> Passage {
    let line = LineConfig::new_8n1(baud);
    let mut messages: Vec<(Instant, Vec<u8>)> = (0..12)
        .map(|n| (ms(100 * (u64::from(n) + 1)), status(n)))
        .collect();
    messages.push((asked + DELAY, ANSWER.to_vec()));
    messages.sort();
    let mut arrivals: Vec<Arrival> = Vec::new();
    for (at, bytes) in messages {
        let before = arrivals.last().map_or(Instant::ZERO, |last| last.at);
        for mut record in records(how, line, at, &bytes) {
            record.at = record.at.max(before);
            arrivals.push(record);
        }
    }
    let mut sent = Track::default();
    sent.push(asked, ASK);
    Passage {
        link: "hoist".to_owned(),
        baud,
        sent,
        arrivals,
        opened: opened.to_vec(),
        ..Passage::default()
    }
}

/// All bytes, each with the time of its piece, up to 1.3 s. The program asks at `ask`.
fn heard(mut talk: Conversation, ask: Instant) -> Vec<(Instant, u8)> {
    let (mut all, mut asks) = (Vec::new(), Some(ask));
    talk.open(ms(0));
    loop {
        let due = talk.poll_at().filter(|&at| at <= ms(1_300));
        let at = match (due, asks) {
            (due, Some(ask)) if due.is_none_or(|due| due >= ask) => {
                asks = None;
                talk.receive(ask, ASK);
                ask
            }
            (Some(due), _) => due,
            (None, _) => return all,
        };
        talk.poll(at);
        let mut buf = [0; 64];
        while let len @ 1.. = talk.transmit(&mut buf) {
            all.extend(buf[..len].iter().map(|&byte| (at, byte)));
        }
    }
}

/// Whole frames in their order, whatever the rate, the division into records, the phase of the
/// captured request, and that of the program.
#[test]
fn no_byte_overtakes_another_and_no_frame_is_interrupted() {
    for baud in [9_600, 57_600, 1_000_000] {
        for how in [
            Records::Whole,
            Records::Bytes,
            Records::Close,
            Records::Frames,
            Records::Paused,
        ] {
            for (asked, is_on_line) in [
                (305, true),
                (340, false),
                (350, true),
                (392, false),
                (399, true),
            ] {
                let passage = captured(baud, how, ms(asked), &[]);
                let talk = Conversation::new(&passage, &(ms(0)..ms(1_250)), is_on_line);
                for phase in 0..16 {
                    let ask = Instant::from_micros(500_000 + 6_250 * phase);
                    let heard = heard(talk.clone(), ask);
                    let bytes: Vec<u8> = heard.iter().map(|&(_, byte)| byte).collect();
                    let place = bytes.windows(ANSWER.len()).position(|part| part == ANSWER);
                    let what = format!("{baud} {how:?} {asked} {phase}: {bytes:02X?}");
                    let place = place.expect(&what);
                    let mut stream = bytes.clone();
                    stream.drain(place..place + ANSWER.len());
                    let expected: Vec<u8> = (0..12).flat_map(status).collect();
                    assert!(stream.starts_with(&expected), "{what}");
                    assert!(place % 16 == 0, "{what}");
                }
            }
        }
    }
}

/// The answer comes as late after its request as in the capture, although the program asks earlier
/// after the opening, later, or while frames are sent. It waits at most for one frame.
#[test]
fn an_answer_beside_a_stream_keeps_its_delay() {
    for opened in [&[][..], &[ms(0)], &[ms(40)], &[ms(250)]] {
        for how in [Records::Whole, Records::Bytes, Records::Close] {
            let passage = captured(57_600, how, ms(450), opened);
            let start = opened.first().copied().unwrap_or_default();
            let talk = Conversation::new(&passage, &(start..ms(1_250)), false);
            for ask in [0, 3, 60, 97, 420, 450, 700, 1_150] {
                let heard = heard(talk.clone(), ms(ask));
                let bytes: Vec<u8> = heard.iter().map(|&(_, byte)| byte).collect();
                let place = bytes.windows(ANSWER.len()).position(|part| part == ANSWER);
                let what = format!("{opened:?} {how:?} {ask}");
                let end = heard[place.expect(&what) + ANSWER.len() - 1].0;
                // The last record of `Close` is 132 us early in the capture.
                let (least, most) = (ms(ask + 29), ms(ask + 35));
                assert!(least < end && end < most, "{what}: {end}");
            }
        }
    }
}

/// Unsolicited messages and answers that begin alike: two or three bytes of a header, words of a
/// line, or the same message on request, in addition to the periodic ones.
#[test]
fn an_answer_is_told_from_unsolicited_messages_that_begin_alike() {
    for (unsolicited, answer) in [
        (&b"\xAA\x55\x06\x01abcdef"[..], &b"\xAA\x55\x03\x02xyz"[..]),
        (b"\xAA\x55\x00\x01abcdef", b"\xAA\x55\x00\x02xyz"),
        (b"\xAA\x01abcdef", b"\xAA\x02xyz"),
        (b"$GPRMC,1\r\n", b"$PMTK001,3\r\n"),
        (b"temp 21.5\r\n", b"temp 21.5\r\n"),
        (b"\xAA\x55\x06\x01abcdef", b"\xAA\x55\x06\x01abcdef"),
    ] {
        let mut passage = Passage {
            link: "probe".to_owned(),
            baud: 1_000_000,
            opened: vec![ms(10)],
            ..Passage::default()
        };
        let mut said: Vec<(u64, &[u8])> = (1..=20).map(|n| (n * 100, unsolicited)).collect();
        said.push((960, answer));
        said.sort_by_key(|&(at, _)| at);
        passage.arrivals = said
            .iter()
            .map(|&(at, bytes)| Arrival {
                at: ms(at),
                bytes: bytes.to_vec(),
            })
            .collect();
        passage.sent.push(ms(940), ASK);
        let talk = Conversation::new(&passage, &(ms(10)..ms(2_010)), false);
        let heard = heard(talk, ms(30));
        let first: Vec<u8> = heard
            .iter()
            .take_while(|one| one.0 == ms(50))
            .map(|&(_, byte)| byte)
            .collect();
        assert_eq!(first, answer, "{unsolicited:02X?}");
    }
}
