//! Captures written by hand, and programs that differ from the captured one.

use super::*;
use crate::divergence::Track;
use crate::replay::Arrival;

fn ms(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

/// A link with these messages of the program and of the other side at these milliseconds. A byte
/// takes 10 us.
fn passage(sent: &[(u64, &[u8])], said: &[(u64, &[u8])]) -> Passage {
    let mut track = Track::default();
    for &(at, bytes) in sent {
        track.push(ms(at), bytes);
    }
    let arrival = |&(at, bytes): &(u64, &[u8])| Arrival {
        at: ms(at),
        bytes: bytes.to_vec(),
    };
    Passage {
        link: "meter".to_owned(),
        baud: 1_000_000,
        sent: track,
        arrivals: said.iter().map(arrival).collect(),
        ..Passage::default()
    }
}

fn talk(passage: &Passage) -> Conversation {
    Conversation::new(passage, &(Instant::ZERO..ms(100_000)), false)
}

/// Messages sent up to `until`, with their times in milliseconds.
fn said(talk: &mut Conversation, until: u64) -> Vec<(u64, Vec<u8>)> {
    let mut all = Vec::new();
    while let Some(at) = talk.poll_at().filter(|&at| at <= ms(until)) {
        talk.poll(at);
        let mut buf = [0; 64];
        let len = talk.transmit(&mut buf);
        if len > 0 {
            all.push((at.as_millis(), buf[..len].to_vec()));
        }
    }
    all
}

fn words(list: &[(u64, &[u8])]) -> Vec<(u64, Vec<u8>)> {
    let owned = |&(at, bytes): &(u64, &[u8])| (at, bytes.to_vec());
    list.iter().map(owned).collect()
}

/// Requests for volts and watts of a Modbus meter, 1.02 s after the capture began.
const VOLTS: &[u8] = &[1, 4, 0, 0, 0, 2, 0x71, 0xCB];
const WATTS: &[u8] = &[1, 4, 0, 12, 0, 2, 0xB1, 0xC8];

fn meter() -> Passage {
    let sent = [(1020, VOLTS), (1050, WATTS), (1080, VOLTS)];
    passage(
        &sent,
        &[(1030, b"\x01v1"), (1062, b"\x01w1"), (1090, b"\x01v2")],
    )
}

/// The replies follow 10, 12 and 10 ms after their requests, whenever these are made.
#[test]
fn an_answer_comes_as_late_after_its_request_as_it_did() {
    let mut talk = talk(&meter());
    talk.open(ms(0));
    assert_eq!(said(&mut talk, 4_000), words(&[]));
    for (at, request, answer) in [
        (5_000, VOLTS, (5_010, b"\x01v1")),
        (9_000, WATTS, (9_012, b"\x01w1")),
        (9_500, VOLTS, (9_510, b"\x01v2")),
    ] {
        talk.receive(ms(at), request);
        assert_eq!(said(&mut talk, at + 300), words(&[(answer.0, answer.1)]));
    }
    assert!(talk.is_done());
    assert_eq!(talk.divergence(), None);
    assert_eq!(talk.tally().to_string(), "3 of 3 requests were made");
    // The capture does not say whether further requests are right, so they are counted.
    for (at, request) in [(9_900, VOLTS), (9_960, b"\x01\x06")] {
        talk.receive(ms(at), request);
        said(&mut talk, at + 50);
    }
    assert_eq!(talk.divergence(), None);
    let tally = talk.tally().to_string();
    let more = "1 repeated, 1 after the last one of the capture";
    assert_eq!(tally, format!("3 of 3 requests were made, {more}"));
}

/// The device sends temperatures by itself, also after requests. A repeated request gets its reply
/// again, and no temperature of the past.
#[test]
fn lines_of_the_device_itself_are_not_repeated() {
    let get: &[u8] = b"GET volts\n";
    let sent: [(u64, &[u8]); 2] = [(1_000, get), (5_000, b"SET limit\n")];
    let said_then: [(u64, &[u8]); 5] = [
        (1_010, b"OK 12\n"),
        (2_000, b"TEMP 1\n"),
        (3_000, b"TEMP 2\n"),
        (5_010, b"OK\n"),
        (6_000, b"TEMP 3\n"),
    ];
    let mut talk = talk(&passage(&sent, &said_then));
    talk.receive(ms(1_000), get);
    assert_eq!(said(&mut talk, 4_999), words(&said_then[..3]));
    talk.receive(ms(5_000), b"SET limit\n");
    assert_eq!(said(&mut talk, 7_999), words(&said_then[3..]));
    talk.receive(ms(8_000), get);
    assert_eq!(said(&mut talk, 20_000), words(&[(8_010, b"OK 12\n")]));
}

/// A request in three pieces, the last one late, is one request.
#[test]
fn a_request_may_come_in_pieces() {
    let mut talk = talk(&meter());
    talk.receive(ms(1), &VOLTS[..1]);
    talk.receive(ms(2), &VOLTS[1..7]);
    assert_eq!(said(&mut talk, 400), words(&[]));
    talk.receive(ms(400), &VOLTS[7..]);
    assert_eq!(said(&mut talk, 500), words(&[(410, b"\x01v1")]));
    let tally = talk.tally();
    assert_eq!((tally.made, tally.unknown), (1, 0));
}

#[test]
fn another_order_and_a_retry_are_the_same_conversation() {
    let mut talk = talk(&meter());
    talk.receive(ms(10), WATTS);
    assert_eq!(said(&mut talk, 100), words(&[(22, b"\x01w1")]));
    talk.receive(ms(100), WATTS);
    assert_eq!(
        said(&mut talk, 200),
        words(&[(112, b"\x01w1")]),
        "asked again"
    );
    talk.receive(ms(200), VOLTS);
    assert_eq!(
        said(&mut talk, 300),
        words(&[(210, b"\x01v2")]),
        "the next one of its kind"
    );
    talk.receive(ms(300), VOLTS);
    assert_eq!(
        said(&mut talk, 400),
        words(&[(310, b"\x01v1")]),
        "the one that was left out"
    );
    assert!(talk.is_done());
    assert_eq!(talk.divergence(), None);
    let tally = Tally {
        all: 3,
        made: 3,
        out_of_turn: 2,
        repeated: 1,
        unknown: 0,
        later: 0,
    };
    assert_eq!(talk.tally(), tally);
}

/// Register 14 instead of 12, with a correct checksum: byte 3 of the second request, number 11 from
/// zero. The request gets the reply to the most similar one, so that the program continues.
#[test]
fn a_request_that_the_capture_does_not_have_is_told_with_both_sides() {
    let mut talk = talk(&meter());
    talk.receive(ms(10), VOLTS);
    said(&mut talk, 40);
    talk.receive(ms(50), &[1, 4, 0, 14, 0, 2, 0x10, 0x08]);
    // The request is known after 20 ms of silence; the reply is then already late.
    assert_eq!(said(&mut talk, 200), words(&[(70, b"\x01w1")]));
    let divergence = talk.divergence().expect("one byte differs");
    insta::assert_snapshot!(divergence, @r"
    0.050000 s, meter to-device, byte 11: expected 0x0c, got 0x0e
      expected: 8 bytes: 01 04 00 [0C] 00 02 B1 C8
      got:      8 bytes: 01 04 00 [0E] 00 02 10 08
      1 of 3 requests were made, 1 not in the capture
    ");
    talk.receive(ms(300), VOLTS);
    said(&mut talk, 400);
    assert!(talk.is_done());
}

/// The program ends after two of three requests. No more is expected after 2 s plus four times the
/// longest gap, 1.02 s.
#[test]
fn what_is_never_asked_is_missing() {
    let mut talk = talk(&meter());
    for (at, request) in [(0, VOLTS), (50, WATTS)] {
        talk.receive(ms(at), request);
        said(&mut talk, at + 50);
    }
    let over = |talk: &Conversation, at| are_over([talk], ms(at), ms(70));
    assert!(!talk.is_done() && !over(&talk, 6_100) && over(&talk, 6_200));
    let divergence = talk.divergence().expect("one is missing");
    assert_eq!((divergence.expected, divergence.got), (Some(1), None));
    assert_eq!(divergence.frames[1], "nothing more");
}

/// Lines of text in the format of an ELM327.
#[test]
fn a_wrong_line_is_told_as_text() {
    let sent: [(u64, &[u8]); 2] = [(10, b"ATZ\r"), (700, b"ATE0\r")];
    let mut talk = talk(&passage(
        &sent,
        &[(650, b"ELM327 v1.5\r\r>"), (710, b"OK\r\r>")],
    ));
    talk.receive(ms(0), b"ATZ\r");
    let answer: Vec<u8> = said(&mut talk, 660)
        .into_iter()
        .flat_map(|(_, bytes)| bytes)
        .collect();
    assert_eq!(answer, b"ELM327 v1.5\r\r>");
    talk.receive(ms(700), b"ATE1\r");
    let divergence = talk.divergence().expect("another line");
    assert_eq!(divergence.frames, ["text \"ATE0\\r\"", "text \"ATE1\\r\""]);
}

/// The prompt of one reply is not part of the next, which comes 20 ms later.
#[test]
fn a_prompt_belongs_to_its_own_answer() {
    let sent: [(u64, &[u8]); 2] = [(10, b"ATE0\r"), (31, b"ATH1\r")];
    let mut talk = talk(&passage(&sent, &[(30, b"OK\r\r>"), (51, b"OK\r\r>")]));
    for at in [1_000, 2_000] {
        talk.receive(ms(at), if at == 1_000 { b"ATE0\r" } else { b"ATH1\r" });
        let answer = said(&mut talk, at + 500);
        let bytes: Vec<u8> = answer
            .iter()
            .flat_map(|(_, bytes)| bytes)
            .copied()
            .collect();
        assert_eq!(
            (&bytes[..], answer.last().map(|one| one.0)),
            (&b"OK\r\r>"[..], Some(at + 20))
        );
    }
}

/// A satellite receiver sends a sentence each second, and one reply. The sentences follow their own
/// clock from the opening; the reply waits for its request.
#[test]
fn what_the_far_end_says_by_itself_follows_its_own_clock() {
    let said_then: [(u64, &[u8]); 5] = [
        (1_000, b"$GPRMC,1\r\n"),
        (2_000, b"$GPRMC,2\r\n"),
        (2_550, b"$PMTK001,0\r\n"),
        (3_000, b"$GPRMC,3\r\n"),
        (4_000, b"$GPRMC,4\r\n"),
    ];
    let sent: [(u64, &[u8]); 1] = [(2_500, b"$PMTK220\r\n")];
    let mut talk = talk(&passage(&sent, &said_then));
    talk.open(ms(100));
    assert_eq!(said(&mut talk, 3_200).len(), 3);
    talk.receive(ms(3_500), b"$PMTK220\r\n");
    let rest = words(&[(3_550, b"$PMTK001,0\r\n"), (4_100, b"$GPRMC,4\r\n")]);
    assert_eq!(said(&mut talk, 5_000), rest);
    assert!(talk.is_done());
}

/// The rest of a scanner's stream is not sent after the stop command. The line that a slow sensor
/// sends 400 ms after a reply is still sent.
#[test]
fn a_new_request_ends_a_stream_and_nothing_else() {
    let mut said_then: Vec<(u64, &[u8])> = (1..=50).map(|n| (n * 10, &[7, 7, 7][..])).collect();
    said_then.extend([(700, &b"ok"[..]), (1_100, b"tick")]);
    let sent: [(u64, &[u8]); 3] = [(0, b"\xA5\x20"), (690, b"\xA5\x25"), (1_500, b"\xA5\x52")];
    let mut talk = talk(&passage(&sent, &said_then));
    talk.receive(ms(0), b"\xA5\x20");
    assert_eq!(said(&mut talk, 101).len(), 10);
    talk.receive(ms(103), b"\xA5\x25");
    assert_eq!(said(&mut talk, 200), words(&[(113, b"ok")]));
    talk.receive(ms(300), b"\xA5\x52");
    assert_eq!(said(&mut talk, 900), words(&[(513, b"tick")]));
    assert_eq!(talk.divergence(), None);
}

/// A greeting is sent at each opening of the port; if the capture begins with it, 100 ms later.
#[test]
fn a_greeting_follows_each_opening() {
    let sent: [(u64, &[u8]); 1] = [(900, b"a")];
    let mut talk = talk(&passage(&sent, &[(200, b"hello"), (910, b"A")]));
    talk.open(ms(1_000));
    assert_eq!(said(&mut talk, 2_000), words(&[(1_200, b"hello")]));
    talk.close();
    talk.open(ms(3_000));
    assert_eq!(said(&mut talk, 4_000), words(&[(3_200, b"hello")]));
    let mut begins = Conversation::new(
        &passage(&[], &[(200, b"hello")]),
        &(ms(200)..ms(300)),
        false,
    );
    begins.open(ms(0));
    assert_eq!(said(&mut begins, 400), words(&[(100, b"hello")]));
}

/// On a line of 10 us a byte, five bytes are passed to it 50 us before they are complete.
#[test]
fn a_line_takes_its_own_time() {
    let mut talk = Conversation::new(&passage(&[], &[(200, b"hello")]), &(ms(0)..ms(300)), true);
    talk.open(ms(0));
    assert_eq!(talk.poll_at(), Some(Instant::from_micros(199_950)));
}

/// The capture of a program that polls one register and writes another contains the same request
/// hundreds of times. A program that polls half as fast completes all of them. A program that
/// repeats a poll, and so is a turn ahead, need not make up for an omitted turn.
#[test]
fn many_turns_of_the_same_requests_are_gone_through() {
    let turns: Vec<(u64, &[u8])> = (0..200)
        .flat_map(|n| [(n * 20, VOLTS), (n * 20 + 10, WATTS)])
        .collect();
    let answers: Vec<(u64, &[u8])> = (0..400).map(|n| (n * 10 + 4, &b"\x01v1"[..])).collect();
    let mut talk = talk(&passage(&turns, &answers));
    for turn in 0..200_u64 {
        let repeats = if turn == 50 { 3 } else { 1 };
        for (request, offset) in [(VOLTS, 0), (WATTS, 20)] {
            for repeat in 0..repeats {
                let at = turn * 40 + offset + repeat;
                talk.receive(ms(at), request);
                said(&mut talk, at);
            }
        }
    }
    said(&mut talk, 9_000);
    assert!(talk.is_done(), "{}", talk.tally());
    assert_eq!(talk.divergence(), None);
}

/// A program that polls forever continues after all requests were made. The conversation is over a
/// second after its last new reply, or at the end of the session if that is later.
#[test]
fn a_program_that_asks_for_ever_does_not_hold_up_the_end() {
    let mut talk = talk(&meter());
    for (turn, request) in [VOLTS, WATTS, VOLTS].into_iter().enumerate() {
        talk.receive(ms(100 * turn as u64), request);
        said(&mut talk, 100 * turn as u64 + 50);
    }
    // The last reply is complete at 210 ms.
    for at in (300..5_000).step_by(100) {
        talk.receive(ms(at), VOLTS);
        assert_eq!(said(&mut talk, at + 50).len(), 1, "it is answered");
        assert_eq!(
            are_over([&talk], ms(at + 50), ms(70)),
            at + 50 >= 1_210,
            "{at}"
        );
        assert_eq!(
            are_over([&talk], ms(at + 50), ms(3_000)),
            at + 50 >= 3_000,
            "{at}"
        );
    }
}

/// The last request of the capture has no reply, because the device was silent. A program that
/// repeats it gets the reply to the previous equal request.
#[test]
fn a_request_that_is_made_again_is_answered_if_it_ever_was() {
    let sent: [(u64, &[u8]); 2] = [(10, b"GD\n"), (60, b"GD\n")];
    let mut talk = talk(&passage(&sent, &[(20, b"1\n")]));
    let mut asks = |at: u64| {
        talk.receive(ms(at), b"GD\n");
        said(&mut talk, at + 40).len()
    };
    assert_eq!([asks(0), asks(50), asks(100), asks(150)], [1, 0, 1, 1]);
    assert_eq!(talk.tally().repeated, 2);
}

/// A range finder sends every 10 ms to the end of the capture. A slower program continues to
/// receive its messages; the conversation still ends.
#[test]
fn a_stream_without_an_end_goes_on() {
    let frames: Vec<(u64, &[u8])> = (1..=200).map(|n| (n * 10, &b"YYabcdefg"[..])).collect();
    let sent: [(u64, &[u8]); 1] = [(505, b"BW")];
    let ends = |end| Conversation::new(&passage(&sent, &frames), &(Instant::ZERO..ms(end)), false);
    let mut talk = ends(2_005);
    talk.open(ms(0));
    talk.receive(ms(100), b"BW");
    let times: Vec<u64> = said(&mut talk, 4_000).iter().map(|one| one.0).collect();
    assert_eq!(times, (1..=400).map(|n| n * 10).collect::<Vec<_>>());
    assert!(are_over([&talk], ms(4_000), ms(2_005)));
    // A device that fell silent 3 s before the end of the capture does not.
    let mut talk = ends(5_000);
    talk.open(ms(0));
    assert_eq!(said(&mut talk, 9_000).len(), 200);
}

/// A scanner sends a turn every 10 ms after its start command, until the capture ends at 500 ms. A
/// slower program reads turns for two seconds, and gets none after the next command.
#[test]
fn a_stream_that_a_request_has_started_goes_on_until_the_next_one() {
    let turns: Vec<(u64, &[u8])> = (2..50).map(|n| (n * 10, &b"YYabc"[..])).collect();
    let passage = passage(&[(5, b"\x01"), (10, b"\x20")], &turns);
    let session = Instant::ZERO..ms(500);
    let mut talk = Conversation::new(&passage, &session, false);
    talk.receive(ms(5), b"\x01");
    talk.receive(ms(10), b"\x20");
    let heard = said(&mut talk, 2_500);
    let expected: Vec<u64> = (2..=250).map(|n| n * 10).collect();
    let times: Vec<u64> = heard.iter().map(|&(at, _)| at).collect();
    assert_eq!(times, expected);
    talk.receive(ms(2_505), b"\x01");
    assert!(said(&mut talk, 5_000).len() <= LEFT_MAX);
}

/// Only figures that are not zero are printed.
#[test]
fn a_tally_tells_what_there_is() {
    let tally = Tally {
        all: 9,
        made: 4,
        out_of_turn: 1,
        repeated: 2,
        unknown: 3,
        later: 5,
    };
    assert_eq!(
        tally.to_string(),
        "4 of 9 requests were made, 1 out of turn, 2 repeated, 3 not in the capture, 5 after the \
         last one of the capture"
    );
}

/// Four times the longest gap, 1.02 s, after 2 s, or 10 s before the program has sent anything.
#[test]
fn a_silent_program_is_waited_for_longer() {
    let mut talk = talk(&meter());
    talk.open(ms(0));
    assert_eq!(talk.patience(), Duration::from_millis(10_000 + 4 * 1_020));
    talk.receive(ms(5), VOLTS);
    assert_eq!(talk.patience(), Duration::from_millis(2_000 + 4 * 1_020));
    let mut unknown = Conversation::new(&meter(), &(Instant::ZERO..ms(100_000)), false);
    unknown.receive(ms(5), b"\x09");
    assert_eq!(unknown.patience(), Duration::from_millis(2_000 + 4 * 1_020));
}

/// An opening that the capture has is progress; a further one is none, and its greeting is no news.
#[test]
fn a_further_opening_is_no_progress() {
    let mut passage = passage(&[], &[(200, b"hello"), (1_200, b"again")]);
    passage.opened = vec![ms(100), ms(1_100)];
    let mut talk = Conversation::new(&passage, &(ms(100)..ms(2_000)), false);
    for (at, moved, greeting) in [
        (0, 100, b"hello"),
        (5_000, 5_100, b"again"),
        (9_000, 5_100, b"again"),
    ] {
        talk.open(ms(at));
        assert_eq!(talk.moved_at(), ms(if at == 9_000 { moved } else { at }));
        assert_eq!(said(&mut talk, at + 500), words(&[(at + 100, greeting)]));
        assert_eq!(talk.moved_at(), ms(moved), "{at}");
        // A second opening without a close is none.
        talk.open(ms(at + 600));
        assert_eq!(talk.poll_at(), None);
        talk.close();
    }
    assert_eq!(talk.said(), 15);
}

/// A conversation is complete once the port was opened, and everything was sent and taken.
#[test]
fn a_conversation_is_complete_when_all_was_sent() {
    let mut talk = talk(&passage(&[], &[(200, b"hello")]));
    assert!(!talk.is_done());
    talk.open(ms(0));
    assert!(!talk.is_done());
    talk.poll(ms(200));
    assert!(!talk.is_done() && talk.has_more());
    assert_eq!(talk.transmit(&mut [0; 64]), 5);
    assert!(talk.is_done() && !talk.has_more());
    assert_eq!((talk.said(), talk.link()), (5, "meter"));
}

/// A silent program is waited for up to its patience: 10 s and four times 1.02 s.
#[test]
fn a_conversation_is_over_after_its_patience() {
    let mut talk = talk(&meter());
    talk.open(ms(0));
    let is_over = |talk: &Conversation, at| are_over([talk], at, ms(70));
    let patience = ms(10_000 + 4 * 1_020);
    assert!(!is_over(&talk, patience));
    assert!(is_over(&talk, patience + Duration::from_nanos(1)));
    assert!(
        !are_over([&talk], ms(20_000), ms(20_001)),
        "the session lasts"
    );
    // Of two conversations, both have to be over.
    let mut late = talk.clone();
    late.receive(ms(14_000), VOLTS);
    assert!(!are_over([&talk, &late], ms(15_000), ms(70)));
}
