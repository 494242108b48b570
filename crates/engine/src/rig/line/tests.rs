//! A line without a rig: 1 Mbaud, so that a byte takes 10 us.

use super::*;
use crate::rig::fault::{Activity, Damage, Effect, FaultId, Rate, Strike, Window};

const LINE: LineConfig = LineConfig::new_8n1(1_000_000);

fn line() -> Line {
    let end = |node| End {
        node,
        port: Port(0),
    };
    Line::new(end(0), end(1))
}

fn take(line: &mut Line, at_us: u64, bytes: &[u8]) -> u64 {
    let (start, budget) = (Instant::from_micros(at_us), &mut Budget::default());
    let ends = line.take(start, LINE, LINE, budget, bytes);
    assert!(line.conserves_bytes());
    ends.as_micros()
}

/// All deliveries within a millisecond; the line is polled each microsecond.
fn deliveries(line: &mut Line) -> Vec<Delivery> {
    let mut all = Vec::new();
    for micros in 0..1000 {
        while let Some(delivery) = line.deliver(Instant::from_micros(micros)) {
            assert!(line.conserves_bytes());
            all.push(delivery);
        }
    }
    all
}

/// Deliveries as time in us and bytes.
fn arrivals(line: &mut Line) -> Vec<(u64, Vec<u8>)> {
    let all = deliveries(line).into_iter();
    all.map(|one| (one.at.as_micros(), one.bytes)).collect()
}

fn during(line: &mut Line, from_us: u64, until_us: u64, effect: Effect) {
    let window = Window {
        from: Instant::from_micros(from_us),
        until: Instant::from_micros(until_us),
    };
    let id = FaultId(0);
    line.faults.add(id, Activity::from(window), effect);
}

fn strike(line: &mut Line, byte: u64, damage: Damage) {
    line.faults.add_strike(Strike { byte, damage });
}

const fn micros(us: u64) -> Duration {
    Duration::from_micros(us)
}

/// Three bytes on an ideal line: 30 us later they are there, and the next may begin.
#[test]
fn bytes_take_their_time() {
    let mut line = line();
    let at = Instant::from_micros;
    assert_eq!((line.poll_at(at(0)), line.has_room(at(0))), (None, true));
    assert_eq!(take(&mut line, 0, &[1, 2, 3]), 30);
    assert_eq!((line.free_at(), line.in_flight()), (at(30), 3));
    assert_eq!([29, 30].map(|us| line.has_room(at(us))), [false, true]);
    assert!(line.deliver(at(29)).is_none());
    let delivery = line.deliver(at(30)).expect("it is time");
    assert_eq!((delivery.at, &*delivery.bytes), (at(30), &[1, 2, 3][..]));
    assert!(delivery.event.is_none() && delivery.original.is_none());
    assert_eq!((line.in_flight(), line.poll_at(at(30))), (0, None));
    let traffic = Traffic {
        sent: 3,
        delivered: 3,
        ..Traffic::default()
    };
    assert_eq!(line.traffic(), traffic);
}

/// The line is free before the bytes arrive. Then it polls a sender that had more bytes, and does
/// not poll one that had none.
#[test]
fn a_line_waits_for_its_sender_as_well_as_for_its_bytes() {
    let mut line = line();
    line.latency = micros(5);
    take(&mut line, 0, &[7]);
    let at = Instant::from_micros;
    assert_eq!(line.poll_at(at(0)), Some(at(10)));
    assert_eq!(line.poll_at(at(10)), Some(at(15)));
    line.is_silent = true;
    assert_eq!(line.poll_at(at(0)), Some(at(15)));
    let delivery = deliveries(&mut line).remove(0);
    assert_eq!(delivery.at, at(15));
    let original = delivery.original.expect("it was late");
    assert_eq!(original.at, at(10));
    assert!(original.is_only_late(&[7]));
    assert!(!original.is_only_late(&[8]));
}

/// Bytes that appear or disappear without a count are detected: 10 - 3 + 2 - 1 = 4 + 1 + 3.
#[test]
fn bytes_are_conserved_if_the_sums_are_equal() {
    let mut line = line();
    line.traffic = Traffic {
        sent: 10,
        lost: 3,
        added: 2,
        delivered: 4,
        framing_errors: 1,
        resampled: -1,
    };
    line.in_flight = 3;
    assert!(line.conserves_bytes());
    let breaks: [fn(&mut Line); 7] = [
        |line| line.traffic.sent += 1,
        |line| line.traffic.lost += 1,
        |line| line.traffic.added += 1,
        |line| line.traffic.delivered += 1,
        |line| line.traffic.framing_errors += 1,
        |line| line.traffic.resampled += 1,
        |line| line.in_flight += 1,
    ];
    for break_it in breaks {
        let mut broken = line.clone();
        break_it(&mut broken);
        assert!(!broken.conserves_bytes(), "{:?}", broken.traffic);
    }
}

/// From 20 to 50 us no byte is delivered: a byte that arrives at 20 us still passes, the rest at 50
/// us. Another stall that begins before the first one ends continues to 70 us.
#[test]
fn a_stall_holds_back_what_arrives_within_it() {
    let stalled = |stalls: &[[u64; 2]]| {
        let mut line = line();
        for &[from, until] in stalls {
            during(&mut line, from, until, Effect::Stall);
        }
        (0..5).for_each(|byte| {
            take(&mut line, 10 * u64::from(byte), &[byte]);
        });
        let times = arrivals(&mut line).into_iter().map(|(at, _)| at);
        times.collect::<Vec<_>>()
    };
    assert_eq!(stalled(&[]), [10, 20, 30, 40, 50]);
    assert_eq!(stalled(&[[20, 50]]), [10, 20, 50, 50, 50]);
    assert_eq!(stalled(&[[20, 50], [40, 70]]), [10, 20, 70, 70, 70]);
}

/// Three bytes arrive while the receiver has room for two: the third is lost, and the receiver gets
/// a report. Later it has room again.
#[test]
fn a_receiver_that_does_not_look_loses_what_it_has_no_room_for() {
    let mut line = line();
    during(&mut line, 15, 50, Effect::Overrun { fifo: 2 });
    during(&mut line, 60, 90, Effect::Overrun { fifo: 1 });
    (0..8).for_each(|byte| {
        take(&mut line, 10 * u64::from(byte), &[byte]);
    });
    let all = deliveries(&mut line).into_iter();
    let all: Vec<_> = all
        .map(|one| (one.at.as_micros(), one.bytes, one.event))
        .collect();
    let lost = Some(LineEvent::Overrun);
    let expected = [
        (10, vec![0], None),
        (50, vec![1], None),
        (50, vec![2], None),
        (50, vec![], lost),
        (50, vec![4], None),
        (60, vec![5], None),
        (90, vec![6], None),
        (90, vec![], lost),
    ];
    assert_eq!(all, expected);
    let traffic = line.traffic();
    assert_eq!((traffic.lost, traffic.delivered), (2, 6));
}

/// If the receiver has room for a part of a piece, the line delivers this part.
#[test]
fn a_piece_may_be_lost_in_part() {
    let mut line = line();
    during(&mut line, 5, 100, Effect::Overrun { fifo: 3 });
    take(&mut line, 0, &[1, 2]);
    take(&mut line, 20, &[3, 4, 5]);
    assert_eq!(arrivals(&mut line), [(100, vec![1, 2]), (100, vec![3])]);
    assert_eq!(line.traffic().lost, 2);
}

/// Five bytes arrive in two pieces of two bytes and one of one byte, each 5 us after its own time.
#[test]
fn a_short_read_gives_pieces_at_their_own_times() {
    let mut line = line();
    line.latency = micros(5);
    during(&mut line, 0, 1000, Effect::ShortRead { len: 2 });
    assert_eq!(take(&mut line, 0, &[1, 2, 3, 4, 5]), 50);
    let expected = [(25, vec![1, 2]), (45, vec![3, 4]), (55, vec![5])];
    assert_eq!(arrivals(&mut line), expected);
    take(&mut line, 100, &[6, 7]);
    assert_eq!(arrivals(&mut line), [(125, vec![6, 7])]);
}

/// A sender pauses for 100 us before its third byte, and then for 30 us before its fourth. Later
/// bytes shift by that, and so does the time of the next byte that the line can take.
#[test]
fn a_pause_shifts_all_that_follows() {
    let mut line = line();
    strike(&mut line, 2, Damage::Idle { by: micros(100) });
    strike(&mut line, 3, Damage::Idle { by: micros(30) });
    assert_eq!(take(&mut line, 0, &[1, 2, 3, 4]), 40);
    assert_eq!(line.free_at(), Instant::from_micros(170));
    let expected = [(20, vec![1, 2]), (130, vec![3]), (170, vec![4])];
    assert_eq!(arrivals(&mut line), expected);
    let mut line = self::line();
    strike(&mut line, 0, Damage::Idle { by: micros(100) });
    take(&mut line, 0, &[1, 2]);
    assert_eq!(arrivals(&mut line), [(120, vec![1, 2])]);
}

/// Bytes never overtake each other: a late byte delays those behind it.
#[test]
fn what_is_late_is_not_overtaken() {
    let mut line = line();
    let by = micros(100);
    during(&mut line, 0, 5, Effect::Latency { by });
    take(&mut line, 0, &[1]);
    take(&mut line, 10, &[2]);
    take(&mut line, 150, &[3]);
    let expected = [(110, vec![1]), (110, vec![2]), (160, vec![3])];
    assert_eq!(arrivals(&mut line), expected);
}

/// The damage of a fault is stored with its bytes, and with no others.
#[test]
fn what_was_sent_is_kept_where_something_else_arrives() {
    let mut line = line();
    strike(&mut line, 1, Damage::Duplicate);
    strike(&mut line, 4, Damage::Drop);
    during(&mut line, 50, 60, Effect::ShortRead { len: 9 });
    for (at, byte) in [(0, 1), (10, 2), (20, 3), (30, 4), (40, 5), (50, 6)] {
        take(&mut line, at, &[byte]);
    }
    let all = deliveries(&mut line);
    let kept = all.iter().map(|one| one.original.as_ref());
    let kept: Vec<_> = kept
        .map(|kept| kept.map(|kept| (&*kept.bytes, kept.strikes.len(), kept.effects.len())))
        .collect();
    let expected = [
        None,
        Some((&[2][..], 1, 0)),
        None,
        None,
        Some((&[5][..], 1, 0)),
        Some((&[6][..], 0, 1)),
    ];
    assert_eq!(kept, expected);
    let traffic = line.traffic();
    assert_eq!((traffic.added, traffic.lost), (1, 1));
    assert_eq!((traffic.sent, traffic.delivered), (6, 6));
}

/// Any other damage is reported, even if the bytes arrive unchanged: a byte replaced by an equal
/// one, an echo, a wrong rate with correctly read bytes.
#[test]
fn what_more_than_time_befell_is_not_only_late() {
    let late = Original {
        at: Instant::ZERO,
        bytes: vec![1, 2],
        strikes: Vec::new(),
        effects: Vec::new(),
        bauds: None,
    };
    assert!(late.is_only_late(&[1, 2]));
    let (byte, damage) = (0, Damage::Drop);
    let others = [
        Original {
            strikes: vec![Strike { byte, damage }],
            ..late.clone()
        },
        Original {
            effects: vec!["echo"],
            ..late.clone()
        },
        Original {
            bauds: Some([9600, 9601]),
            ..late.clone()
        },
        Original {
            bytes: vec![1, 2, 3],
            ..late
        },
    ];
    for other in others {
        assert!(!other.is_only_late(&[1, 2]), "{other:?}");
    }
}

/// A byte held back until the next one is in flight.
#[test]
fn a_byte_that_is_held_back_is_in_flight() {
    let mut line = line();
    strike(&mut line, 0, Damage::Swap);
    take(&mut line, 0, &[1]);
    assert_eq!(line.in_flight(), 1);
    take(&mut line, 10, &[2]);
    assert_eq!(arrivals(&mut line), [(10, vec![]), (20, vec![2, 1])]);
    assert_eq!((line.traffic().added, line.traffic().lost), (0, 0));
}

#[test]
fn a_parity_error_is_told_and_its_byte_is_lost() {
    let mut line = line();
    strike(&mut line, 0, Damage::ParityError);
    take(&mut line, 0, &[1]);
    take(&mut line, 10, &[2]);
    let all = deliveries(&mut line);
    let events: Vec<_> = all.iter().map(|one| one.event).collect();
    assert_eq!(events, [Some(LineEvent::ParityError), None]);
    // A receiver that does not check parity reads it all the same.
    let mark = Mark {
        before: 0,
        value: 1,
        damage: MarkDamage::Parity,
    };
    assert_eq!((&*all[0].marks, &*all[1].marks), (&[mark][..], &[][..]));
    assert_eq!((line.traffic().lost, line.traffic().delivered), (1, 1));
}

/// An echo consists of the arriving bytes, after the last bit was sent; the opposite line adds it
/// to its own.
#[test]
fn an_echo_is_for_the_other_line() {
    let mut line = line();
    during(&mut line, 0, 5, Effect::Echo);
    strike(&mut line, 0, Damage::Flip { bit: 0 });
    take(&mut line, 0, &[8, 9]);
    let (at, bytes) = line.take_echo().expect("it hears itself");
    assert_eq!((at.as_micros(), &*bytes), (20, &[9, 9][..]));
    assert!(line.take_echo().is_none());
    take(&mut line, 20, &[8]);
    assert!(line.take_echo().is_none());
    let mut back = self::line();
    back.receive(at, bytes);
    assert_eq!((back.traffic().added, back.in_flight()), (2, 2));
    assert_eq!(arrivals(&mut back), [(20, vec![9, 9])]);
}

/// A recording plays in place of the sender: the sender's bytes take their time and are lost.
#[test]
fn a_recording_arrives_in_the_place_of_what_is_sent() {
    let mut line = line();
    line.is_played = true;
    assert_eq!(take(&mut line, 0, &[1, 2]), 20);
    assert_eq!(line.free_at().as_micros(), 20);
    line.play(Instant::from_micros(50), &[3, 4, 5], 2);
    assert_eq!(line.in_flight(), 5);
    let all = deliveries(&mut line);
    assert_eq!(all.len(), 1);
    assert_eq!(
        (all[0].at.as_micros(), &*all[0].bytes),
        (50, &[3, 4, 5][..])
    );
    assert_eq!(all[0].event, Some(LineEvent::FramingError));
    assert_eq!(all[0].framing_errors, 2);
    let traffic = Traffic {
        sent: 2,
        lost: 2,
        added: 5,
        delivered: 3,
        framing_errors: 2,
        resampled: 0,
    };
    assert_eq!(line.traffic(), traffic);
}

/// By hand, see the resampler: 48 69 read at half the rate are one byte, 9C. It is complete only
/// after the line was idle for two characters of the slower rate: two times 20 us after the end of
/// the bytes at 20 us.
#[test]
fn a_receiver_at_half_the_rate_reads_half_as_many() {
    let mut line = line();
    let slow = LineConfig::new_8n1(500_000);
    let budget = &mut Budget::default();
    line.take(Instant::ZERO, LINE, slow, budget, &[0x48, 0x69]);
    assert!(line.conserves_bytes());
    assert_eq!(line.traffic().resampled, -2);
    let at = Instant::from_micros;
    line.is_silent = true;
    assert_eq!(line.poll_at(at(0)), Some(at(20)));
    let all = deliveries(&mut line);
    let original = all[0].original.as_ref().expect("it is read differently");
    assert_eq!(original.bauds, Some([1_000_000, 500_000]));
    assert_eq!(original.bytes, [0x48, 0x69]);
    let arrived: Vec<_> = all
        .iter()
        .map(|one| (one.at.as_micros(), &*one.bytes))
        .collect();
    assert_eq!(arrived, [(20, &[][..]), (60, &[0x9C])]);
    assert_eq!(line.traffic().resampled, -1);
}

/// A sender that is 100 % too fast takes half the time, and its receiver reads at the agreed rate.
#[test]
fn a_sender_at_a_wrong_rate_takes_its_own_time() {
    let mut line = line();
    let rate = Rate {
        baud: Some(2_000_000),
        ppm: 0.0,
        ppm_per_s: 0.0,
    };
    during(&mut line, 0, 1000, Effect::WrongBaud(rate));
    assert_eq!(take(&mut line, 0, &[0x48, 0x69]), 10);
    let bytes: Vec<u8> = arrivals(&mut line)
        .into_iter()
        .flat_map(|(_, b)| b)
        .collect();
    assert_eq!(bytes, [0x9C]);
}

/// The receiver takes nothing: the line no longer polls the sender, and an echo is lost.
#[test]
fn a_line_holds_so_many_pieces_and_no_more() {
    let mut line = line();
    let at = Instant::from_micros;
    for piece in 0..CHUNKS_MAX as u64 {
        assert!(line.has_room(at(10 * piece)));
        line.take_clean(at(10 * piece), LINE, &[1]);
    }
    let full = at(10 * CHUNKS_MAX as u64);
    assert!(!line.has_room(full));
    line.receive(full, vec![1]);
    assert_eq!(line.traffic().added, 0);
    let delivery = line.deliver(full).expect("much is due");
    line.recycle(delivery.bytes);
    assert!(line.has_room(full));
    line.receive(full, vec![1]);
    assert_eq!(line.traffic().added, 1);
}

/// Buffers are kept for later, a few of them.
#[test]
fn a_few_buffers_are_used_again() {
    let mut line = line();
    (0..6).for_each(|_| line.recycle(vec![1, 2, 3]));
    assert_eq!(line.spare.len(), 4);
    take(&mut line, 0, &[9]);
    assert_eq!(line.spare.len(), 3);
    assert_eq!(arrivals(&mut line), [(10, vec![9])]);
}

/// Four characters, one of them with a wrong parity bit, into a queue of two or three bytes that is
/// read at 100 us. If the third one is damaged it comes after two bytes: the short queue was full
/// before it. The second one comes after one byte, when there is room.
#[test]
fn a_full_queue_has_no_room_for_a_damaged_character() {
    let marks = |damaged, fifo| {
        let mut line = line();
        strike(&mut line, damaged, Damage::ParityError);
        during(&mut line, 0, 100, Effect::Overrun { fifo });
        take(&mut line, 1, &[1, 2, 3, 4]);
        let delivery = deliveries(&mut line).remove(0);
        (delivery.bytes, delivery.marks.len())
    };
    assert_eq!(marks(2, 2), (vec![1, 2], 0));
    assert_eq!(marks(2, 3), (vec![1, 2, 4], 1));
    assert_eq!(marks(1, 2), (vec![1, 3], 1));
}

/// Marks before bytes 1, 4 and 6. A piece of bytes 2 to 5 takes the first one, which lies before
/// it, and the second one; the third belongs to the next piece, which begins with byte 6.
#[test]
fn marks_are_counted_from_the_piece_they_arrive_with() {
    let mark = |before| Mark {
        before,
        value: 0,
        damage: MarkDamage::Parity,
    };
    let mut marks = vec![mark(1), mark(4), mark(6)];
    assert_eq!(Mark::split(&mut marks, 2, 6), [mark(0), mark(2)]);
    assert_eq!(marks, [mark(6)]);
}

/// A pause damages no byte: the bytes come with its report all the same.
#[test]
fn a_pause_is_told_with_the_bytes_that_it_delays() {
    let mut line = line();
    strike(&mut line, 1, Damage::Idle { by: micros(5) });
    take(&mut line, 0, &[1]);
    take(&mut line, 10, &[2]);
    let all = deliveries(&mut line);
    let times: Vec<u64> = all.iter().map(|one| one.at.as_micros()).collect();
    assert_eq!(times, [10, 25]);
    let strikes = all.iter().map(|one| {
        let original = one.original.as_ref();
        original.map(|original| original.strikes.len())
    });
    assert_eq!(strikes.collect::<Vec<_>>(), [None, Some(1)]);
}

/// The latency of the line and that of a fault add up: 10 + 7 + 20 us.
#[test]
fn latencies_of_line_and_fault_add_up() {
    let mut line = line();
    line.latency = micros(7);
    during(&mut line, 0, 5, Effect::Latency { by: micros(20) });
    take(&mut line, 0, &[1]);
    take(&mut line, 10, &[2]);
    // The second byte is not delayed by the fault, but does not overtake the first one.
    assert_eq!(arrivals(&mut line), [(37, vec![1]), (37, vec![2])]);
}

/// A pause before a byte that is lost: nothing is left behind it but an empty piece, 100 us later.
#[test]
fn a_pause_before_a_lost_byte_is_kept() {
    let mut line = line();
    strike(&mut line, 2, Damage::Idle { by: micros(100) });
    strike(&mut line, 2, Damage::Drop);
    take(&mut line, 0, &[1, 2, 3]);
    assert_eq!(line.free_at(), Instant::from_micros(130));
    assert_eq!(arrivals(&mut line), [(20, vec![1, 2]), (130, vec![])]);
}

/// By hand, see the resampler: 48 69 read at half the rate are 9C, which is whole only in the
/// silence behind it. None of it is read when the pause ends, at 20 + 100 us, and nothing arrives
/// before that.
#[test]
fn a_pause_of_bytes_that_are_read_later_is_kept() {
    let mut line = line();
    let slow = LineConfig::new_8n1(500_000);
    strike(&mut line, 1, Damage::Idle { by: micros(100) });
    let budget = &mut Budget::default();
    let ends = line.take(Instant::ZERO, LINE, slow, budget, &[0x48, 0x69]);
    assert_eq!((ends.as_micros(), line.free_at().as_micros()), (20, 120));
    assert_eq!(arrivals(&mut line), [(120, vec![]), (120, vec![0x9C])]);
}

/// A character without a parity bit, read with one: 03 is left out, and its error is logged when
/// the line has been quiet for two characters of 11 bits, 22 us.
#[test]
fn a_character_that_ends_in_silence_is_counted() {
    let mut line = line();
    let even = LineConfig {
        parity: protocols::Parity::Even,
        ..LINE
    };
    let budget = &mut Budget::default();
    line.take(Instant::ZERO, LINE, even, budget, &[0x03]);
    assert_eq!(line.traffic().resampled, -1);
    let all = deliveries(&mut line).into_iter();
    let all: Vec<_> = all
        .map(|one| {
            (
                one.at.as_micros(),
                one.bytes.len(),
                one.framing_errors,
                one.marks.len(),
            )
        })
        .collect();
    assert_eq!(all, [(10, 0, 0, 0), (32, 0, 1, 1)]);
    let traffic = line.traffic();
    assert_eq!((traffic.resampled, traffic.framing_errors), (0, 1));
}

/// 61 62 00 read at half the rate are one character without a stop bit, see the resampler: three
/// bytes become none and one error, and the sums are equal all the time.
#[test]
fn a_character_without_a_stop_bit_is_counted() {
    let mut line = line();
    let slow = LineConfig::new_8n1(500_000);
    let budget = &mut Budget::default();
    line.take(Instant::ZERO, LINE, slow, budget, &[0x61, 0x62, 0x00]);
    assert_eq!((line.traffic().resampled, line.in_flight()), (-2, 1));
    assert!(line.conserves_bytes());
    let first = line.deliver(Instant::from_micros(30)).expect("it is time");
    assert_eq!(
        (first.framing_errors, first.event),
        (1, Some(LineEvent::FramingError))
    );
    assert!(line.conserves_bytes());
    assert_eq!((line.traffic().framing_errors, line.in_flight()), (1, 0));
}

/// A used buffer carries the bytes of a line with latency, too, and of one that was silent.
#[test]
fn late_bytes_use_a_buffer_again() {
    let mut line = line();
    line.latency = micros(1);
    line.recycle(vec![1, 2, 3]);
    line.recycle(vec![1, 2, 3]);
    take(&mut line, 0, &[9]);
    assert_eq!(line.spare.len(), 1);
    assert_eq!(arrivals(&mut line), [(11, vec![9])]);
}

/// Without a fault at work the line is as fast as one without faults: a stall that is over and one
/// that comes later withhold nothing.
#[test]
fn a_stall_withholds_nothing_outside_its_time() {
    let mut line = line();
    during(&mut line, 0, 5, Effect::Stall);
    during(&mut line, 45, 70, Effect::Stall);
    for (at_us, byte) in [(0, 1), (10, 2), (20, 3), (30, 4), (40, 5), (70, 6)] {
        take(&mut line, at_us, &[byte]);
    }
    let times: Vec<u64> = arrivals(&mut line).iter().map(|(at, _)| *at).collect();
    assert_eq!(times, [10, 20, 30, 40, 70, 80]);
}

/// Stalls without a gap between them withhold a byte until the last one ends, at 100 us.
#[test]
fn many_stalls_in_a_row_withhold_a_byte_until_the_last_one() {
    let mut line = line();
    for us in 0..99 {
        during(&mut line, us, us + 2, Effect::Stall);
    }
    take(&mut line, 0, &[1]);
    assert_eq!(
        line.poll_at(Instant::from_micros(10)),
        Some(Instant::from_micros(100))
    );
}
