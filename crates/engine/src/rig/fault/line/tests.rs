use protocols::LineConfig;

use super::*;
use crate::rig::fault::{HostDamage, Rate};

const LINE: LineConfig = LineConfig::new_8n1(1_000_000);

/// All bytes in one go.
fn through(faults: &mut LineFaults, bytes: &[u8]) -> Vec<u8> {
    let mut all = Vec::new();
    for (number, byte) in (0..).zip(bytes) {
        // 10 us a byte at 1 Mbaud: back to back.
        let (start, mut passed) = (Instant::from_micros(10 * number), Passed::default());
        let budget = &mut Budget::default();
        faults.pass(number, &[*byte], start, LINE, budget, &mut passed);
        all.extend(passed.bytes);
    }
    all
}

fn struck(damage: Damage) -> LineFaults {
    let mut faults = LineFaults::default();
    faults.add_strike(Strike { byte: 1, damage });
    faults
}

/// Each damage hits byte 1 of five; the arriving bytes are written down by hand.
#[test]
fn each_damage_hits_the_byte_it_names() {
    let arrives = |damage| through(&mut struck(damage), &[1, 2, 3, 4, 5]);
    assert_eq!(arrives(Damage::Flip { bit: 7 }), [1, 0x82, 3, 4, 5]);
    assert_eq!(arrives(Damage::Drop), [1, 3, 4, 5]);
    assert_eq!(
        arrives(Damage::Insert { value: 0xEE }),
        [1, 0xEE, 2, 3, 4, 5]
    );
    assert_eq!(arrives(Damage::Duplicate), [1, 2, 2, 3, 4, 5]);
    let burst = Damage::Burst { len: 3, mask: 0xF0 };
    assert_eq!(arrives(burst), [1, 0xF2, 0xF3, 0xF4, 5]);
    assert_eq!(arrives(Damage::Truncate { len: 3 }), [1, 5]);
    assert_eq!(arrives(Damage::Truncate { len: 900 }), [1]);
    assert_eq!(arrives(Damage::Swap), [1, 3, 2, 4, 5]);
    assert_eq!(arrives(Damage::ParityError), [1, 3, 4, 5]);
    let idle = Damage::Idle {
        by: Duration::from_millis(1),
    };
    assert_eq!(arrives(idle), [1, 2, 3, 4, 5]);
}

/// A truncation ends where the sender pauses for two characters, 20 us.
#[test]
fn a_truncation_ends_at_the_next_pause() {
    let mut faults = struck(Damage::Truncate { len: 900 });
    let mut passed = Passed::default();
    let budget = &mut Budget::default();
    for (number, at_us) in [(0, 0), (1, 10), (2, 20), (3, 50), (4, 60)] {
        let start = Instant::from_micros(at_us);
        faults.pass(
            number,
            &[u8::try_from(number).expect("small")],
            start,
            LINE,
            budget,
            &mut passed,
        );
    }
    assert_eq!(passed.bytes, [0, 3, 4]);
}

#[test]
fn a_byte_that_waits_for_the_next_one_is_counted() {
    let mut faults = struck(Damage::Swap);
    assert_eq!(through(&mut faults, &[1, 2]), [1]);
    assert_eq!(faults.held(), 1);
    assert!(!faults.is_clean());
}

#[test]
fn a_cut_silences_its_window_only() {
    let mut faults = LineFaults::default();
    let window = Window {
        from: Instant::from_micros(10),
        until: Instant::from_micros(30),
    };
    faults.add_cut(FaultId(0), window);
    assert_eq!(through(&mut faults, &[1, 2, 3, 4]), [1, 4]);
}

/// The recorded strikes of a random fault do the same in a second run.
#[test]
fn recorded_strikes_repeat_what_the_rate_did() {
    let bytes: Vec<u8> = (0..=255).cycle().take(4000).collect();
    let mut random = LineFaults::default();
    for kind in DamageKind::ALL {
        let rng = Rng::stream(1, &format!("{kind:?}"));
        random.add_rate(FaultId(0), kind, Window::ALWAYS, 0.02, rng);
    }
    let first = through(&mut random, &bytes);
    assert_ne!(first, bytes);

    let mut recorded = LineFaults::default();
    random
        .struck()
        .for_each(|&strike| recorded.add_strike(strike));
    assert_eq!(through(&mut recorded, &bytes), first);
}

/// Random numbers are drawn for every byte, two a byte, also for those before the window and for
/// faults that others overtake. So the streams alone determine the lost bytes.
#[test]
fn dice_are_thrown_for_bytes_outside_the_window_too() {
    let windows = [(0, 900), (500, 700), (650, 2_000), (100, 400), (950, 960)];
    let stream = |fault: usize| Rng::stream(5, &format!("test.{fault}"));
    let mut faults = LineFaults::default();
    for (fault, (from, until)) in windows.into_iter().enumerate() {
        let window = Window {
            from: Instant::from_micros(10 * from),
            until: Instant::from_micros(10 * until),
        };
        let id = FaultId(fault);
        faults.add_rate(id, DamageKind::Drop, window, 0.05, stream(fault));
    }
    let bytes: Vec<u8> = (0..1_000_u32).map(|byte| byte.to_le_bytes()[0]).collect();
    let arrived = through(&mut faults, &bytes);

    let mut dice: Vec<Rng> = (0..windows.len()).map(stream).collect();
    let mut expected = Vec::new();
    for (number, byte) in (0..).zip(&bytes) {
        let mut is_lost = false;
        for (dice, (from, until)) in dice.iter_mut().zip(windows) {
            let is_hit = dice.chance(0.05);
            dice.next_u64();
            is_lost |= is_hit && (from..until).contains(&number);
        }
        expected.extend((!is_lost).then_some(*byte));
    }
    assert_eq!(arrived, expected);
    assert!((900..995).contains(&arrived.len()), "{}", arrived.len());
}

#[test]
fn a_rate_of_zero_touches_nothing() {
    let mut faults = LineFaults::default();
    for kind in DamageKind::ALL {
        let rng = Rng::stream(1, "none");
        faults.add_rate(FaultId(0), kind, Window::ALWAYS, 0.0, rng);
    }
    assert_eq!(through(&mut faults, &[7; 1000]), [7; 1000]);
}

/// A fault with a count strikes as often as the count and no more.
#[test]
fn a_count_wears_off() {
    let mut faults = LineFaults::default();
    let effect = Effect::Strikes {
        kind: DamageKind::Drop,
        chance: 1.0,
        left: Some(3),
        rng: Box::new(Rng::stream(1, "three")),
    };
    faults.add(FaultId(0), Window::ALWAYS.into(), effect);
    assert_eq!(through(&mut faults, &[1, 2, 3, 4, 5]), [4, 5]);
}

/// Frames of two bytes, 20 us of silence between them: the third begins at 80 us.
#[test]
fn a_trigger_waits_for_its_byte_or_frame() {
    let starts = [0, 10, 40, 50, 80, 90];
    let arrives = |trigger| {
        let mut faults = LineFaults::default();
        let mut activity = Activity::from(Window {
            from: Instant::ZERO,
            until: Instant::from_micros(15),
        });
        activity.trigger = Some(trigger);
        faults.add(FaultId(0), activity, Effect::Cut);
        let mut passed = Passed::default();
        for (number, at_us) in (0..).zip(starts) {
            let start = Instant::from_micros(at_us);
            let byte = [u8::try_from(number).expect("small")];
            faults.pass(
                number,
                &byte,
                start,
                LINE,
                &mut Budget::default(),
                &mut passed,
            );
        }
        let activity = faults.activity(FaultId(0)).expect("planned");
        (passed.bytes, activity.window.from)
    };
    assert_eq!(
        arrives(Trigger::Byte(3)),
        (vec![0, 1, 2, 4, 5], Instant::from_micros(50))
    );
    assert_eq!(
        arrives(Trigger::Frame(2)),
        (vec![0, 1, 2, 3], Instant::from_micros(80))
    );
}

/// Passes all of `bytes` in one go at 0 us and returns the result.
fn at_once(faults: &mut LineFaults, bytes: &[u8]) -> Passed {
    let mut passed = Passed::default();
    let budget = &mut Budget::default();
    faults.pass(0, bytes, Instant::ZERO, LINE, budget, &mut passed);
    passed
}

fn window(from_us: u64, until_us: u64) -> Activity {
    Activity::from(Window {
        from: Instant::from_micros(from_us),
        until: Instant::from_micros(until_us),
    })
}

/// Two faults of a kind add up, or the stricter one holds; an inactive fault has no effect.
#[test]
fn what_is_at_work_adds_up_and_is_named() {
    let by = |micros| Effect::Latency {
        by: Duration::from_micros(micros),
    };
    let (early, late) = (window(0, 10), window(10, 20));
    let mut faults = LineFaults::default();
    for effect in [by(3), by(4), Effect::ShortRead { len: 5 }, Effect::Echo] {
        faults.add(FaultId(0), early.clone(), effect);
    }
    faults.add(FaultId(1), early.clone(), Effect::ShortRead { len: 3 });
    faults.add(FaultId(2), late.clone(), by(90));
    faults.add(FaultId(3), late, Effect::Cut);
    let passed = at_once(&mut faults, &[1]);
    assert_eq!(passed.late, Duration::from_micros(7));
    assert_eq!((passed.piece, passed.echo), (Some(3), true));
    assert_eq!(passed.bytes, [1]);
    let names = ["latency", "latency", "short read", "echo", "short read"];
    assert_eq!(passed.effects, names);
    assert_eq!(at_once(&mut LineFaults::default(), &[1]).piece, None);
}

/// The dice of [`jitter`].
fn stream() -> Rng {
    Rng::stream(3, "jitter")
}

fn jitter(by: Duration) -> LineFaults {
    let mut faults = LineFaults::default();
    let rng = Box::new(stream());
    faults.add(
        FaultId(0),
        Window::ALWAYS.into(),
        Effect::Jitter { by, rng },
    );
    faults
}

/// Drawn by the fault's own stream: each time from zero to `by`, both included.
#[test]
fn jitter_is_what_its_dice_say() {
    let mut faults = jitter(Duration::from_nanos(2));
    let mut dice = stream();
    let mut seen = [false; 3];
    for _ in 0..50 {
        let late = at_once(&mut faults, &[0]).late.as_nanos();
        assert_eq!(late, u128::from(dice.below(3)));
        seen[usize::try_from(late).expect("small")] = true;
    }
    assert_eq!(seen, [true; 3]);
    // The longest duration causes no overflow.
    let late = at_once(&mut jitter(Duration::MAX), &[0]).late.as_nanos();
    assert_eq!(late, u128::from(stream().below(u64::MAX)));
}

/// 2 to the power 3 copies of one; of ten doublings 64 are left.
#[test]
fn a_byte_is_doubled_so_often_and_no_more() {
    let copies = |doublings| {
        let mut faults = LineFaults::default();
        for _ in 0..doublings {
            let damage = Damage::Duplicate;
            faults.add_strike(Strike { byte: 0, damage });
        }
        at_once(&mut faults, &[7]).bytes.len()
    };
    assert_eq!([0, 1, 3, 6, 7, 10].map(copies), [1, 2, 8, 64, 64, 64]);
}

/// Inserted bytes count in the numbers of later ones: the pause comes between 9 and 2.
#[test]
fn a_pause_is_before_the_byte_it_names_among_those_that_arrive() {
    let by = Duration::from_millis(1);
    let mut faults = struck(Damage::Insert { value: 9 });
    let damage = Damage::Idle { by };
    faults.add_strike(Strike { byte: 1, damage });
    let passed = at_once(&mut faults, &[1, 2, 3]);
    assert_eq!(
        (passed.bytes, passed.pauses),
        (vec![1, 9, 2, 3], vec![(2, by)])
    );
    assert_eq!(passed.parity_errors, 0);
    let damage = Damage::ParityError;
    let mut faults = struck(damage);
    faults.add_strike(Strike { byte: 2, damage });
    assert_eq!(at_once(&mut faults, &[1, 2, 3]).parity_errors, 2);
}

/// A byte is reported once: a byte that never arrived has no parity.
#[test]
fn a_parity_error_needs_a_byte() {
    let mut faults = LineFaults::default();
    faults.add(
        FaultId(0),
        window(0, 10),
        Effect::Host(HostDamage::StripNul),
    );
    let damage = Damage::ParityError;
    faults.add_strike(Strike { byte: 0, damage });
    assert_eq!(at_once(&mut faults, &[0, 1]).parity_errors, 0);
}

/// A line is not clean while an effect continues: a burst, a truncation, a byte held back.
#[test]
fn a_line_is_clean_when_nothing_goes_on() {
    assert!(LineFaults::default().is_clean());
    for damage in [
        Damage::Burst { len: 3, mask: 1 },
        Damage::Truncate { len: 3 },
        Damage::Swap,
    ] {
        let mut faults = struck(damage);
        assert!(!faults.is_clean());
        through(&mut faults, &[1, 2]);
        assert!(!faults.is_clean(), "{damage}");
        faults.pass(
            2,
            &[3, 4, 5],
            Instant::from_micros(20),
            LINE,
            &mut Budget::default(),
            &mut Passed::default(),
        );
        assert!(faults.is_clean(), "{damage}");
    }
}

/// One of two strikes on a byte is taken back, as long as it has not struck.
#[test]
fn a_strike_is_taken_back_while_it_is_to_come() {
    let strike = |byte, damage| Strike { byte, damage };
    let (flip, drop) = (strike(4, Damage::Flip { bit: 1 }), strike(4, Damage::Drop));
    let first = strike(0, Damage::Drop);
    let mut faults = LineFaults::default();
    for strike in [flip, drop, first] {
        faults.add_strike(strike);
    }
    assert_eq!(faults.to_come().collect::<Vec<_>>(), [first, flip, drop]);
    assert!(faults.remove_strike(flip));
    assert!(!faults.remove_strike(flip));
    assert!(!faults.remove_strike(strike(9, Damage::Drop)));
    assert_eq!(through(&mut faults, &[1, 2, 3]), [2, 3]);
    assert!(!faults.remove_strike(first));
    assert_eq!(faults.to_come().collect::<Vec<_>>(), [drop]);
    assert_eq!(faults.struck().collect::<Vec<_>>(), [&first]);
    assert_eq!(faults.struck_len(), 1);
}

#[test]
fn a_fault_is_ended_left_out_or_numbered_anew() {
    let mut faults = LineFaults::default();
    faults.add_cut(FaultId(0), Window::ALWAYS);
    faults.add_cut(FaultId(1), Window::ALWAYS);
    faults.end(FaultId(1), Instant::from_micros(10));
    faults.renumber(|id| FaultId(id.0 + 7));
    assert!(faults.activity(FaultId(0)).is_none());
    let until = |id| {
        faults
            .activity(FaultId(id))
            .map(|activity| activity.window.until)
    };
    assert_eq!(until(7), Some(Window::ALWAYS.until));
    assert_eq!(until(8), Some(Instant::from_micros(10)));
    faults.leave_out(FaultId(7));
    assert!(faults.activity(FaultId(7)).is_none());
    assert_eq!(through(&mut faults, &[1, 2]), [2]);
}

/// Frames are not counted before the first fault: the first byte after that begins a frame, number
/// 0.
#[test]
fn frames_are_counted_from_the_first_that_is_seen() {
    let mut faults = LineFaults::default();
    let mut activity = window(0, 25);
    activity.trigger = Some(Trigger::Frame(1));
    faults.add(FaultId(0), activity, Effect::Cut);
    let mut passed = Passed::default();
    for (number, at_us) in [(5, 500), (6, 510), (7, 540), (8, 550), (9, 560), (10, 570)] {
        let start = Instant::from_micros(at_us);
        let byte = [u8::try_from(number).expect("small")];
        faults.pass(
            number,
            &byte,
            start,
            LINE,
            &mut Budget::default(),
            &mut passed,
        );
    }
    assert_eq!(passed.bytes, [5, 6, 10]);
}

/// While the fault is active, the sender's line coding has half the rate.
#[test]
fn a_sender_has_its_own_rate_while_it_is_wrong() {
    let mut faults = LineFaults::default();
    let rate = |ppm_per_s| Rate {
        baud: Some(500_000),
        ppm: 0.0,
        ppm_per_s,
    };
    faults.add(
        FaultId(0),
        window(10, 1_000_000),
        Effect::WrongBaud(rate(0.0)),
    );
    let baud = |faults: &LineFaults, us| faults.sender_line(LINE, Instant::from_micros(us)).baud;
    assert_eq!(
        [9, 10, 999_999, 1_000_000].map(|us| baud(&faults, us)),
        [1_000_000, 500_000, 500_000, 1_000_000]
    );
    let mut faults = LineFaults::default();
    faults.add(
        FaultId(0),
        window(1_000_000, 9_000_000),
        Effect::WrongBaud(rate(1000.0)),
    );
    // Two seconds of its own: 500000 x 1.002.
    assert_eq!(baud(&faults, 3_000_000), 501_000);
}

/// Of several gates, the one that opens last decides.
#[test]
fn a_gate_stays_closed_as_long_as_any() {
    let mut faults = LineFaults::default();
    faults.add(FaultId(0), window(10, 50), Effect::Stall);
    faults.add(FaultId(1), window(20, 40), Effect::Overrun { fifo: 3 });
    faults.add(FaultId(2), window(20, 60), Effect::Overrun { fifo: 2 });
    let gate = |us| {
        let gate = faults.gate(Instant::from_micros(us))?;
        Some((gate.opens.as_micros(), gate.fifo))
    };
    assert_eq!(
        [5, 10, 15, 20].map(gate),
        [None, None, Some((50, None)), Some((50, None))]
    );
    assert_eq!(
        [25, 55, 60].map(gate),
        [Some((60, Some(2))), Some((60, Some(2))), None]
    );
}

/// The delay of each message is from zero to `by`, both included; the longest duration causes no
/// overflow.
#[test]
fn the_jitter_of_messages_is_what_its_dice_say() {
    let mut faults = jitter(Duration::from_nanos(2));
    let mut dice = stream();
    let late = (0..50).map(|number| {
        let passed = faults.pass_message(number, Instant::ZERO, &mut Budget::default());
        assert_eq!(passed.late.as_nanos(), u128::from(dice.below(3)));
        passed.late.as_nanos()
    });
    assert_eq!(late.max(), Some(2));
    let mut faults = jitter(Duration::MAX);
    let passed = faults.pass_message(0, Instant::ZERO, &mut Budget::default());
    assert_eq!(passed.late.as_nanos(), u128::from(stream().below(u64::MAX)));
}

fn span(from_us: u64, until_us: u64) -> Window {
    Window {
        from: Instant::from_micros(from_us),
        until: Instant::from_micros(until_us),
    }
}

/// Byte 1 is lost instead of byte 0; the fault of byte 3 stays.
#[test]
fn a_moved_fault_leaves_the_others_alone() {
    let mut faults = LineFaults::default();
    faults.add_cut(FaultId(0), span(0, 10));
    faults.add_cut(FaultId(1), span(30, 40));
    faults.move_to(FaultId(0), span(10, 20));
    assert_eq!(through(&mut faults, &[1, 2, 3, 4, 5]), [1, 3, 5]);
}

/// Random faults draw their numbers in the order in which they were added, in whichever order they
/// begin: the budget of a run depends on it.
#[test]
fn random_faults_that_begin_in_reverse_keep_their_order() {
    let mut faults = LineFaults::default();
    for (number, from_us) in [(0, 30), (1, 20), (2, 10), (3, 25)] {
        let rng = Rng::stream(1, &number.to_string());
        let always = span(from_us, 1_000_000);
        faults.add_rate(FaultId(number), DamageKind::Flip, always, 0.5, rng);
    }
    let mut seen = Vec::new();
    for at in [10, 20, 25, 30] {
        faults.look(Instant::from_micros(at));
        seen.push(faults.order.striking.clone());
    }
    assert_eq!(seen, [vec![2], vec![1, 2], vec![1, 2, 3], vec![0, 1, 2, 3]]);
}

/// A jitter of 1 ns delays by 0 or 1 ns, bytes as well as messages.
#[test]
fn a_jitter_reaches_its_greatest_delay() {
    let jitter = || {
        let mut faults = LineFaults::default();
        let by = Duration::from_nanos(1);
        let rng = Box::new(Rng::stream(1, "jitter"));
        let effect = Effect::Jitter { by, rng };
        faults.add(FaultId(0), Window::ALWAYS.into(), effect);
        faults
    };
    let (mut bytes, mut messages) = (jitter(), jitter());
    let budget = &mut Budget::default();
    let mut seen = [std::collections::BTreeSet::new(), Default::default()];
    for number in 0..50 {
        let start = Instant::from_micros(10 * number);
        let mut passed = Passed::default();
        bytes.pass(number, &[1], start, LINE, budget, &mut passed);
        seen[0].insert(passed.late.as_nanos());
        let passed = messages.pass_message(number, start, budget);
        seen[1].insert(passed.late.as_nanos());
    }
    for delays in seen {
        assert_eq!(delays.into_iter().collect::<Vec<_>>(), [0, 1]);
    }
}

/// Bytes 5, 6 and 7 begin at 50 us. Byte 6 ends at 70 us, with both of its damages, and byte 7 at
/// 80 us.
#[test]
fn damage_is_kept_with_the_end_of_its_byte() {
    let mut faults = LineFaults::default();
    let strikes = [
        (6, Damage::Flip { bit: 0 }),
        (6, Damage::Duplicate),
        (7, Damage::Drop),
    ];
    let strikes = strikes.map(|(byte, damage)| Strike { byte, damage });
    strikes
        .into_iter()
        .for_each(|strike| faults.add_strike(strike));
    let (start, budget) = (Instant::from_micros(50), &mut Budget::default());
    let mut passed = Passed::default();
    faults.pass(5, &[1, 2, 3], start, LINE, budget, &mut passed);
    assert_eq!(passed.bytes, [1, 3, 3]);
    let times = faults
        .struck_times()
        .map(|(strike, at)| (strike, at.as_micros()));
    let expected = strikes.into_iter().zip([70, 70, 80]);
    assert!(times.eq(expected));
}

/// The list of damaged bytes has room for 1,048,576; the next ones are damaged all the same.
#[test]
fn a_full_list_of_damage_grows_no_more() {
    let mut faults = LineFaults::default();
    let strike = |byte| Strike {
        byte,
        damage: Damage::Drop,
    };
    faults.struck = vec![strike(0); STRIKES_MAX - 1].into();
    faults.struck_at = vec![Instant::ZERO; STRIKES_MAX - 1].into();
    faults.add_strike(strike(0));
    faults.add_strike(strike(1));
    assert_eq!(through(&mut faults, &[1, 2, 3]), [3]);
    assert_eq!(faults.struck_len(), STRIKES_MAX);
}

/// A budget of two strikes: five bytes lose the first two. One that is spent at a time when the
/// fault is not at work would lose fewer.
#[test]
fn a_strike_outside_its_spell_costs_nothing() {
    let spells = crate::rig::fault::Spells {
        every: Duration::from_micros(30),
        lasting: Duration::from_micros(10),
        count: None,
        dice: None,
    };
    let lost = |left| {
        let mut faults = LineFaults::default();
        let effect = Effect::Strikes {
            kind: DamageKind::Drop,
            chance: 1.0,
            left,
            rng: Box::new(Rng::stream(1, "test")),
        };
        let activity = Activity {
            spells: Some(spells.clone()),
            ..Activity::from(Window::ALWAYS)
        };
        faults.add(FaultId(0), activity, effect);
        let mut budget = Budget::new(Some(3), None);
        (0..12)
            .filter(|&number| {
                let mut passed = Passed::default();
                let start = Instant::from_micros(10 * number);
                faults.pass(number, &[7], start, LINE, &mut budget, &mut passed);
                passed.bytes.is_empty()
            })
            .collect::<Vec<u64>>()
    };
    // Byte 9 would be the fourth.
    assert_eq!(lost(None), [0, 3, 6]);
    assert_eq!(lost(Some(2)), [0, 3]);
}

/// A host in text mode treats bytes that no other fault touches. 8D is no CR for the first fault.
#[test]
fn a_host_treats_all_bytes_of_its_time() {
    let mut faults = LineFaults::default();
    faults.add(FaultId(0), window(10, 30), Effect::Host(HostDamage::CrToLf));
    faults.add(
        FaultId(1),
        window(20, 30),
        Effect::Host(HostDamage::ClearBit7),
    );
    assert_eq!(through(&mut faults, &[13, 13, 0x8D, 13]), [13, 10, 13, 13]);
    // In the other order it has become one.
    let mut faults = LineFaults::default();
    faults.add(
        FaultId(0),
        window(0, 30),
        Effect::Host(HostDamage::ClearBit7),
    );
    faults.add(FaultId(1), window(0, 30), Effect::Host(HostDamage::CrToLf));
    assert_eq!(at_once(&mut faults, &[0x8D, 13, 65]).bytes, [10, 10, 65]);
}

/// The first byte after the faults were added is number 1 and begins 10 us after the start of the
/// run: it begins frame 0, although the pause before it was short.
#[test]
fn the_first_byte_that_is_seen_begins_a_frame() {
    let mut faults = LineFaults::default();
    let mut activity = window(0, 5);
    activity.trigger = Some(Trigger::Frame(0));
    faults.add(FaultId(0), activity, Effect::Cut);
    let mut passed = Passed::default();
    let budget = &mut Budget::default();
    for (number, at_us) in [(1, 10), (2, 20)] {
        let start = Instant::from_micros(at_us);
        faults.pass(number, &[9], start, LINE, budget, &mut passed);
    }
    assert_eq!(passed.bytes, [9]);
    let activity = faults.activity(FaultId(0)).expect("planned");
    assert_eq!(activity.window.from, Instant::from_micros(10));
}

/// Bytes 3, 4 and 5 come in one piece: a fault that waits for byte 5 begins with the piece, one
/// that waits for byte 6 does not begin.
#[test]
fn a_trigger_in_a_piece_begins_with_the_piece() {
    let begins = |byte| {
        let mut faults = LineFaults::default();
        let mut activity = window(0, 100);
        activity.trigger = Some(Trigger::Byte(byte));
        faults.add(FaultId(0), activity, Effect::Echo);
        let (start, budget) = (Instant::from_micros(70), &mut Budget::default());
        let mut passed = Passed::default();
        faults.pass(3, &[1, 2, 3], start, LINE, budget, &mut passed);
        passed.echo
    };
    assert_eq!([3, 5, 6].map(begins), [true, true, false]);
}

/// Seven bits are inverted one by one: a bit beyond 7 wraps, so bit 9 is bit 1.
#[test]
fn a_flip_inverts_one_bit() {
    let flipped = |bit| at_once(&mut struck(Damage::Flip { bit }), &[0, 0xFF]).bytes[1];
    let expected = [0xFE, 0xFD, 0xFB, 0xF7, 0xEF, 0xDF, 0xBF, 0x7F];
    assert_eq!([0, 1, 2, 3, 4, 5, 6, 7].map(flipped), expected);
    assert_eq!([8, 9, 15].map(flipped), [0xFE, 0xFD, 0x7F]);
}

/// A message counts as one: of three, the one with number 1 is lost, number 2 comes three times
/// doubled, and number 3 late.
#[test]
fn whole_messages_have_their_own_fate() {
    let mut faults = LineFaults::default();
    faults.add_strike(Strike {
        byte: 1,
        damage: Damage::Drop,
    });
    for _ in 0..3 {
        faults.add_strike(Strike {
            byte: 2,
            damage: Damage::Duplicate,
        });
    }
    faults.add_strike(Strike {
        byte: 3,
        damage: Damage::Swap,
    });
    let by = |us| Effect::Latency {
        by: Duration::from_micros(us),
    };
    faults.add(FaultId(0), window(30, 50), by(3));
    faults.add(FaultId(1), window(30, 50), by(4));
    faults.add(FaultId(2), window(40, 50), Effect::Cut);
    faults.add(FaultId(3), window(30, 50), Effect::Echo);
    let fate = |faults: &mut LineFaults, number| {
        let start = Instant::from_micros(10 * number);
        let passed = faults.pass_message(number, start, &mut Budget::default());
        let late = passed.late.as_micros();
        (passed.copies, passed.is_overtaken, late, passed.effects)
    };
    assert_eq!(fate(&mut faults, 0), (1, false, 0, vec![]));
    assert_eq!(fate(&mut faults, 1), (0, false, 0, vec![]));
    assert_eq!(fate(&mut faults, 2), (8, false, 0, vec![]));
    let late = vec!["latency", "latency"];
    assert_eq!(fate(&mut faults, 3), (1, true, 7, late));
    let cut = vec!["latency", "latency", "line cut"];
    assert_eq!(fate(&mut faults, 4), (0, false, 7, cut));
    assert_eq!(fate(&mut faults, 5), (1, false, 0, vec![]));
}

/// Message 2 is the third one: a fault that waits for it, as a byte or as a frame, begins then.
#[test]
fn a_trigger_counts_messages() {
    for trigger in [Trigger::Byte(2), Trigger::Frame(2)] {
        let mut faults = LineFaults::default();
        let mut activity = window(0, 15);
        activity.trigger = Some(trigger);
        faults.add(FaultId(0), activity, Effect::Cut);
        let copies = [0, 1, 2, 3, 4].map(|number| {
            let start = Instant::from_micros(10 * number);
            let passed = faults.pass_message(number, start, &mut Budget::default());
            passed.copies
        });
        assert_eq!(copies, [1, 1, 0, 0, 1], "{trigger:?}");
    }
}

/// A burst of three bytes inverts bits 0 and 1 of each, whatever they were.
#[test]
fn a_burst_inverts_the_bits_of_its_mask() {
    let mut faults = struck(Damage::Burst { len: 3, mask: 0x03 });
    let arrived = at_once(&mut faults, &[0x01, 0x02, 0x03, 0xF0, 0x01]).bytes;
    assert_eq!(arrived, [0x01, 0x01, 0x00, 0xF3, 0x01]);
}
