extern crate std;

use std::vec::Vec;

use ChecksumOrder::HighFirst;
use proptest::prelude::*;

use super::*;

const TIMEOUT: Duration = Duration::from_millis(5);
const WHEELS: Request = Request::read(36, 10);

/// Read of ten registers and its answer, as seen on the fielded slave's wire (b77a6df).
const READ: [u8; 5] = [0xAB, 0x24, 0x0A, 0x00, 0xD9];
const REPLY: [u8; 15] = [
    0xAB, 0x24, 0x8A, 0x04, 0x03, 0x02, 0x01, 0xFE, 0xFF, 0xFF, 0xFF, 0x14, 0xEC, 0x06, 0x5E,
];
const ERROR: [u8; 5] = [0xAB, 0xFF, 0x00, 0x01, 0xAA];

fn at(micros: u64) -> Instant {
    Instant::from_micros(micros)
}

fn link() -> BaseLink {
    BaseLink::new(HighFirst, TIMEOUT)
}

fn sent(link: &mut BaseLink) -> Vec<u8> {
    let mut buf = [0; 64];
    let count = link.transmit(&mut buf);
    buf[..count].to_vec()
}

/// A link with a request to read the wheels that has just left.
fn asked() -> BaseLink {
    let mut link = link();
    link.submit(at(0), WHEELS);
    assert_eq!(sent(&mut link), READ);
    link
}

#[test]
fn a_read_brings_the_golden_data() {
    let mut link = asked();
    link.receive(at(250), &REPLY);
    let mut data = [0; READ_MAX];
    data[..10].copy_from_slice(&REPLY[3..13]);
    let done = Completion {
        request: WHEELS,
        at: at(250),
        outcome: Outcome::Data(data),
    };
    assert_eq!(link.take_completion(), Some(done));
    assert_eq!((link.take_completion(), link.next_at()), (None, None));
}

#[test]
fn a_write_is_done_when_it_is_acknowledged() {
    let mut link = link();
    let write = Request::write(46, [20, 0xEC, 0]);
    link.submit(at(0), write);
    assert_eq!(
        sent(&mut link),
        [0xAB, 0x2E, 0x83, 0x14, 0xEC, 0x00, 0x02, 0x5C]
    );
    link.receive(at(150), &[0xAB, 0x2E, 0x00, 0x00, 0xD9]);
    let done = Completion {
        request: write,
        at: at(150),
        outcome: Outcome::Written,
    };
    assert_eq!(link.take_completion(), Some(done));
}

/// Field defects MA-04 (two bytes for ten), MA-05 (an acknowledgement for data), MA-02 (126
/// bytes announced) and a reply to another register: none of them is an answer.
#[test]
fn only_the_whole_answer_counts() {
    let mut link = asked();
    let mut frames = Vec::from([0xAB, 0x24, 0x82, 0x09, 0x09, 0x01, 0x63]);
    frames.extend([0xAB, 0x24, 0x00, 0x00, 0xCF]);
    frames.extend(Frame::write(36, &[7; 126], HighFirst).as_bytes());
    frames.extend(Frame::write(33, &[7; 10], HighFirst).as_bytes());
    frames.extend(Frame::write(36, &[7; 127], HighFirst).as_bytes());
    link.receive(at(4000), &frames);
    assert_eq!(link.take_completion(), None);
    assert_eq!(link.counters().unsolicited, 5);
    link.receive(at(4100), &REPLY);
    assert!(matches!(
        link.take_completion(),
        Some(Completion {
            outcome: Outcome::Data(_),
            ..
        })
    ));
}

/// Field defect MA-06: an unsolicited frame was written into freed memory.
#[test]
fn an_unsolicited_frame_is_counted_and_dropped() {
    let mut link = link();
    link.receive(
        at(10),
        Frame::write(36, &[0xDE, 0xAD, 0xBE], HighFirst).as_bytes(),
    );
    assert_eq!(
        (link.take_completion(), link.counters().unsolicited),
        (None, 1)
    );
}

/// A frame received before the request has left cannot be its answer.
#[test]
fn an_answer_from_before_the_question_does_not_count() {
    let mut link = link();
    link.submit(at(0), WHEELS);
    link.receive(at(10), &REPLY);
    assert_eq!(
        (link.take_completion(), link.counters().unsolicited),
        (None, 1)
    );
    assert_eq!(sent(&mut link), READ);
}

/// Field program: three tries in all; its callers did not check for the failure (MA-07).
#[test]
fn a_silent_slave_is_asked_three_times_and_then_reported() {
    let mut link = asked();
    assert_eq!(link.next_at(), Some(at(5_000)));
    link.tick(at(5_000));
    assert_eq!(sent(&mut link), READ);
    link.tick(at(10_000));
    assert_eq!(sent(&mut link), READ);
    link.tick(at(15_000));
    assert_eq!(sent(&mut link), []);
    let done = Completion {
        request: WHEELS,
        at: at(15_000),
        outcome: Outcome::Failed,
    };
    assert_eq!(link.take_completion(), Some(done));
    assert_eq!((link.counters().retries, link.counters().failures), (2, 1));
    assert!(!link.is_silent());

    link.submit(at(20_000), WHEELS);
    for tick in 1..=3 {
        link.tick(at(20_000 + tick * 5_000));
    }
    assert!(link.is_silent());
    link.submit(at(50_000), WHEELS);
    sent(&mut link);
    link.receive(at(50_300), &REPLY);
    assert!(!link.is_silent());
}

#[test]
fn an_error_frame_brings_the_next_try_at_once() {
    let mut link = asked();
    link.receive(at(200), &ERROR);
    assert_eq!(sent(&mut link), READ);
    assert_eq!(link.counters().errors, 1);
}

/// A flipped count makes the decoder wait for 122 more bytes; the end of the try releases the bytes
/// behind it, here the answer itself.
#[test]
fn a_damaged_count_costs_one_try_at_most() {
    let mut link = asked();
    link.receive(at(100), &[0xAB, 0x24, 0xFF]);
    link.receive(at(300), &REPLY);
    assert_eq!(link.take_completion(), None);
    link.tick(at(5_000));
    assert!(matches!(
        link.take_completion(),
        Some(Completion {
            outcome: Outcome::Data(_),
            ..
        })
    ));
    assert_eq!(link.counters().retries, 0);
}

/// The acknowledgement of the first try arrives after the second try has left, the second
/// acknowledgement after the transaction is over. It must not count as the acknowledgement of the
/// next write.
#[test]
fn a_late_answer_is_not_taken_for_the_next_one() {
    let mut link = link();
    let ack = Frame::read(46, 0, HighFirst);
    link.submit(at(0), Request::write(46, [20, 20, 0]));
    sent(&mut link);
    link.tick(at(5_000));
    sent(&mut link);
    link.receive(at(5_100), ack.as_bytes());
    assert!(link.take_completion().is_some());

    link.submit(at(5_200), Request::write(46, [0, 0, 0]));
    assert_eq!(sent(&mut link), []);
    link.receive(at(5_400), ack.as_bytes());
    assert_eq!(
        (link.take_completion(), link.counters().unsolicited),
        (None, 1)
    );
    link.tick(at(10_100));
    assert_eq!(
        sent(&mut link),
        Frame::write(46, &[0, 0, 0], HighFirst).as_bytes()
    );
}

/// Field defect MA-08: a second caller stole the answer of a read in flight.
#[test]
fn requests_wait_for_each_other() {
    let mut link = asked();
    link.submit(at(50), Request::read(33, 3));
    link.submit(at(60), Request::write(46, [1, 1, 0]));
    link.submit(at(70), Request::write(46, [2, 2, 0]));
    assert_eq!(sent(&mut link), []);
    link.receive(at(250), &REPLY);
    assert_eq!(sent(&mut link), Frame::read(33, 3, HighFirst).as_bytes());
    link.receive(at(400), Frame::write(33, &[1, 2, 3], HighFirst).as_bytes());
    assert_eq!(
        sent(&mut link),
        Frame::write(46, &[2, 2, 0], HighFirst).as_bytes()
    );
}

#[test]
fn a_flood_of_requests_is_bounded_and_counted() {
    let mut link = asked();
    for register in 0..12 {
        link.submit(at(1), Request::read(register, 1));
    }
    assert_eq!(link.counters().overflows, 4);
}

/// Elapsed time, noise, whether the answer follows the noise, whether to submit a request.
fn step() -> impl Strategy<Value = (u64, Vec<u8>, bool, bool)> {
    let noise = prop::collection::vec(any::<u8>(), 0..40);
    (0_u64..9_000, noise, any::<bool>(), any::<bool>())
}

proptest! {
    /// For any bytes of the slave at any time: no panic, at most three tries a request, and every
    /// request ends.
    #[test]
    fn every_request_ends(steps in prop::collection::vec(step(), 1..60)) {
        let mut link = link();
        let (mut now, mut submitted, mut frames, mut ended) = (0, 0_u32, 0_u32, 0_u32);
        for (wait, mut bytes, answer, ask) in steps {
            now += wait;
            if ask && !link.is_pending(&WHEELS) {
                submitted += 1;
                link.submit(at(now), WHEELS);
            }
            frames += u32::from(!sent(&mut link).is_empty());
            if answer {
                bytes.extend(REPLY);
            }
            if !bytes.is_empty() {
                link.receive(at(now), &bytes);
            }
            link.tick(at(now));
            ended += u32::from(link.take_completion().is_some());
        }
        while let Some(next) = link.next_at() {
            link.tick(next);
            frames += u32::from(!sent(&mut link).is_empty());
            ended += u32::from(link.take_completion().is_some());
        }
        prop_assert_eq!(ended, submitted);
        prop_assert!(frames <= 3 * submitted);
    }
}

/// Finding T5: a frame released by an idle line is checked like any other. A damaged count hid a
/// valid frame of another register, which is no answer. The frame is counted, and the request is
/// sent again.
#[test]
fn a_frame_that_an_idle_line_frees_must_be_the_answer() {
    let mut link = asked();
    link.receive(at(250), &[0xAB, 0x24, 0xFF]);
    link.receive(at(260), Frame::write(33, &[7; 10], HighFirst).as_bytes());
    link.tick(at(5_000));
    assert_eq!(link.take_completion(), None);
    assert_eq!(link.counters().unsolicited, 1);
    assert_eq!(sent(&mut link), READ);
    // The answer itself, hidden in the same way, is taken.
    link.receive(at(5_100), &[0xAB, 0x24, 0xFF]);
    link.receive(at(5_110), &REPLY);
    link.tick(at(10_000));
    let done = link.take_completion().expect("the answer");
    assert_eq!(
        (done.request, matches!(done.outcome, Outcome::Data(_))),
        (WHEELS, true)
    );
}

/// Stale data stays behind ten registers if the link accepts short replies or acknowledgements as
/// answers; else those bytes are 0.
#[test]
fn old_data_is_left_behind_a_reply_of_the_fielded_link() {
    let behind = |takes_short_replies, takes_acknowledgements| {
        let defects = Defects {
            takes_short_replies,
            takes_acknowledgements,
            ..Defects::NONE
        };
        let mut link = BaseLink::with_defects(HighFirst, TIMEOUT, defects);
        link.stale = [7; READ_MAX];
        link.submit(at(0), WHEELS);
        sent(&mut link);
        link.receive(at(250), &REPLY);
        match link.take_completion().map(|done| done.outcome) {
            Some(Outcome::Data(data)) if data[..10] == REPLY[3..13] => data[10..].to_vec(),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(behind(false, false), [0; READ_MAX - 10]);
    assert_eq!(behind(true, false), [7; READ_MAX - 10]);
    assert_eq!(behind(false, true), [7; READ_MAX - 10]);
}

/// There is room for eight outcomes; the ninth, not read by then, is counted and lost.
#[test]
fn outcomes_that_nobody_takes_are_counted_once_there_is_no_room() {
    let mut link = link();
    let overflows: Vec<u32> = (0..10)
        .map(|round| {
            link.submit(at(1_000 * round), WHEELS);
            assert_eq!(sent(&mut link), READ);
            link.receive(at(1_000 * round + 250), &REPLY);
            link.counters().overflows
        })
        .collect();
    assert_eq!(overflows, [0, 0, 0, 0, 0, 0, 0, 0, 1, 2]);
    let taken = core::iter::from_fn(|| link.take_completion()).count();
    assert_eq!(taken, 8);
}
