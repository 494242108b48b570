use protocols::LineConfig;

use super::*;

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

/// Each damage hits byte 1 of five; what arrives is written down by hand.
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

/// What a random fault did, written down and run again, does the same.
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

/// Dice are thrown for every byte, two a byte, also for those before the window and for faults that
/// others overtake: which bytes are lost is said by the streams alone.
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

/// A fault that wears off strikes as often as it says and no more.
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
