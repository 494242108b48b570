//! The blind test on emulated turns alone: equal streams stay hidden, and each mutant is found.

use super::super::twin::Spot;
use super::*;
use crate::rng::Rng;

type Mutate = fn(&mut [Turn]);

/// Turns of a stream: 40 windows.
const TURNS: usize = 80;

/// A square room of 0.9 m with the strength of light walls.
fn square() -> Room {
    let spot = |degree: usize| {
        let (sin, cos) = libm::sincos((degree as f64).to_radians());
        let mm = 450.0 / f64::max(sin.abs(), cos.abs());
        let strength = 1e8 / (mm * mm);
        Some(Spot { mm, strength })
    };
    (0..DEGREES).map(spot).collect()
}

fn accuracy(all: &[Told], group: &str) -> Option<f64> {
    let told = all.iter().find(|told| told.group == group);
    told.expect("a group").accuracy
}

/// Adds noise to the readings: `mm` millimetres to distances, or `root` times the square root of a
/// strength to the strength.
fn noisy(turns: &mut [Turn], mm: f64, root: f64) {
    let mut rng = Rng::stream(7, "mutant");
    for reading in turns.iter_mut().flat_map(|turn| &mut turn.readings) {
        if let Reading::Range {
            distance_mm,
            strength,
            ..
        } = reading
        {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "clamped to what a reading holds"
            )]
            let moved = |value: u16, sigma: f64, way: f64| {
                let found = f64::from(value) + sigma * way;
                found.round().clamp(0.0, 16_000.0) as u16
            };
            *distance_mm = moved(*distance_mm, mm, rng.gauss());
            let sigma = root * f64::from(*strength).sqrt();
            *strength = moved(*strength, sigma, rng.gauss());
        }
    }
}

/// Half as many slots again are skipped.
fn more_skipped(turns: &mut [Turn]) {
    for (degree, reading) in turns
        .iter_mut()
        .flat_map(|turn| turn.readings.iter_mut().enumerate())
    {
        if degree % 48 == 7 {
            *reading = Reading::Invalid {
                code: 0x21,
                strength: 0,
            };
        }
    }
}

/// Each tooth gets half of the next one's speed: the fast part of the wander is lost.
fn smooth(turns: &mut [Turn]) {
    for turn in turns {
        let speeds = &mut turn.speeds_rpm;
        let means: Vec<f64> = speeds
            .windows(2)
            .map(|two| (two[0] + two[1]) / 2.0)
            .collect();
        speeds[..means.len()].copy_from_slice(&means);
    }
}

/// Packets whose carry is dropped are replaced by others.
fn all_carries(turns: &mut [Turn]) {
    for turn in turns {
        let whole = turn
            .packets
            .iter()
            .copied()
            .find(|packet| !drops_carry(packet));
        for packet in &mut turn.packets {
            if let Some(whole) = whole.filter(|_| drops_carry(packet)) {
                *packet = whole;
            }
        }
    }
}

/// Two units of one model look alike, and each fault of the model is found in its own group.
#[test]
fn each_fault_is_found_in_its_group() {
    let twin = Twin::new(Profile::Fw24, square());
    let [real, ours] = [21, 1].map(|seed| twin.turns(seed, TURNS));
    let plain = judged(&real, core::slice::from_ref(&ours));
    assert_eq!(plain.len(), GROUPS.len());
    for told in &plain {
        let accuracy = told.accuracy.expect("compared");
        assert!(
            accuracy <= told.limit() && told.windows == [40, 40],
            "{told:?}"
        );
    }
    let mutants: [(&str, Mutate); 5] = [
        ("packets", all_carries),
        ("tooth speeds", smooth),
        ("distances", |turns| noisy(turns, 0.3, 0.0)),
        ("strengths", |turns| noisy(turns, 0.0, 0.4)),
        ("codes", more_skipped),
    ];
    for (group, mutate) in mutants {
        let mut mutant = ours.clone();
        mutate(&mut mutant);
        let all = judged(&real, &[mutant]);
        let found = accuracy(&all, group).expect("compared");
        assert!(found > 75.0, "{group}: {all:?}");
    }
}

/// Nothing is compared, instead of 50 %: an emulation without steady turns, and a covered lens in
/// both streams.
#[test]
fn a_group_that_one_stream_lacks_is_not_compared() {
    let twin = Twin::new(Profile::Fw24, square());
    let mut turns = twin.turns(1, 16);
    let all = judged(&turns, &[Vec::new()]);
    assert!(all.iter().all(|told| told.accuracy.is_none()), "{all:?}");
    assert_eq!(all.len(), GROUPS.len());
    for reading in turns.iter_mut().flat_map(|turn| &mut turn.readings) {
        *reading = Reading::Invalid {
            code: 0x25,
            strength: 0,
        };
    }
    let all = judged(&turns, core::slice::from_ref(&turns));
    for group in ["distances", "strengths", "codes"] {
        assert_eq!(accuracy(&all, group), None, "{all:?}");
    }
}

/// Reflective tape: strengths of 1,200 at 3 m, and 500 at 4.5 m, are more than a scene's brightest
/// surface returns.
#[test]
fn reflective_tape_is_built_as_the_brightest_surface() {
    for (mm, strength) in [
        (3_000.0, 1_200.0),
        (4_500.0, 500.0),
        (16_383.0, 16_383.0),
        (0.0, 0.0),
    ] {
        let wanted = vec![Some(Spot { mm, strength }); DEGREES];
        let turns = Twin::new(Profile::Fw24, wanted).turns(1, 2);
        assert_eq!(turns.len(), 2, "{mm}");
    }
}

/// The standard error with 40 and 80 windows is half of the root of 0.25 / 40 + 0.25 / 80, which is
/// 4.84 %.
#[test]
fn few_windows_widen_the_limit() {
    let limit = |windows| {
        let told = Told {
            group: "",
            accuracy: None,
            windows,
            is_of_the_unit: false,
            figures: Vec::new(),
        };
        told.limit()
    };
    assert!((limit([40, 80]) - 64.52).abs() < 0.01);
    assert!((limit([120, 240]) - 60.0).abs() < 1e-9);
}

/// By hand, for the pairs (1, 2) and (3, 3): the sum of products, 2 + 9, divided by the sum of mean
/// squares, (1 + 4) / 2 + 9.
#[test]
fn neighbours_that_change_alike_are_together() {
    let changes = [Some(1.0), Some(2.0), None, Some(3.0), Some(3.0)];
    assert!((together(&changes) - 11.0 / 11.5).abs() < 1e-12);
    assert_eq!(together(&[Some(1.0), Some(-1.0)]), -1.0);
    assert_eq!(together(&[None, Some(1.0)]), 0.0);
}

/// A wall at 1 m up to 100 degrees and at 1.013 m from there on, a step of more than 1.2 %: no
/// degree with the step among its two neighbours on both sides counts, nor one beside a person at
/// 200 degrees. Readings are 4 mm and 3 by the root of 400 above the room's.
#[test]
fn readings_of_the_room_are_those_on_even_walls() {
    let mm = |degree: usize| if degree <= 100 { 1_000.0 } else { 1_013.0 };
    let spot = |degree| {
        Some(Spot {
            mm: mm(degree),
            strength: 400.0,
        })
    };
    let room: Room = (0..DEGREES).map(spot).collect();
    let reading = |degree: usize| Reading::Range {
        distance_mm: match degree {
            200 => 500,
            0..=100 => 1_004,
            _ => 1_017,
        },
        strength: 403,
        weak: false,
    };
    let turn = Turn {
        speeds_rpm: Vec::new(),
        readings: (0..DEGREES).map(reading).collect(),
        packets: Vec::new(),
    };
    let found = of_room(&[turn], &room);
    let not_counted = [99..=102, 198..=202, 358..=361];
    for (degree, found) in found[0].iter().enumerate() {
        let is_near = |off: usize| not_counted.iter().any(|all| all.contains(&(degree + off)));
        match is_near(0) || is_near(DEGREES) {
            true => assert_eq!(*found, None, "{degree}"),
            false => assert_eq!(*found, Some([4.0, 0.15]), "{degree}"),
        }
    }
}

/// By hand: 1, 2, 3 and 4 less their mean 2.5 are -1.5, -0.5, 0.5 and 1.5, with a sum of squares of
/// 5 in all. The products of neighbours are 0.75 - 0.25 + 0.75, those of values two apart twice
/// -0.75, and that of values three apart -2.25.
#[test]
fn values_are_alike_to_later_ones() {
    let values = [1.0, 2.0, 3.0, 4.0];
    assert_eq!(alike(&values, 1), 0.25);
    assert_eq!(alike(&values, 2), -0.3);
    assert_eq!(alike(&values, 3), -0.45);
    assert_eq!(alike(&[2.0; 3], 1), 0.0);
}

/// A turn of these readings, without packets.
fn turn_of(reading: impl Fn(usize) -> Reading) -> Turn {
    Turn {
        speeds_rpm: Vec::new(),
        readings: (0..DEGREES).map(reading).collect(),
        packets: Vec::new(),
    }
}

const fn range(distance_mm: u16, strength: u16) -> Reading {
    Reading::Range {
        distance_mm,
        strength,
        weak: false,
    }
}

const fn no_range(code: u8) -> Reading {
    Reading::Invalid { code, strength: 0 }
}

/// A room with a wall at 1 m all around, of strength 400.
fn round() -> Room {
    let spot = Spot {
        mm: 1_000.0,
        strength: 400.0,
    };
    vec![Some(spot); DEGREES]
}

/// The numbers 2, 4, 4, 4, 5, 5, 7 and 9 have the mean 5 and the deviation 2.
#[test]
fn a_deviation_is_the_root_of_the_mean_square() {
    let values = [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0];
    assert_eq!((mean(&values), deviation(&values)), (5.0, 2.0));
    assert_eq!((mean(&[]), deviation(&[])), (0.0, 0.0));
}

/// Degrees 0 to 33 have a distance, so that 2 to 31, thirty of them, have two neighbours on both
/// sides. From one turn to the next ten of them keep their distance, ten more change by 1 mm, and
/// the last ten by 2 mm; strengths change by as many roots of 400. Mean 1, variance 2 / 3. The
/// products of the 29 neighbours are nine times 1, 2 and nine times 4, together 47; their mean
/// squares add up to 48. With a degree less nothing is compared.
#[test]
fn changes_of_thirty_degrees_are_compared() {
    let moved = |degree: usize| u16::try_from((degree.max(2) - 2) / 10).expect("small");
    let window = |valid: usize, mm: u16, root: u16| {
        [0, 1].map(|turn| {
            turn_of(|degree| match degree < valid {
                true => {
                    let way = moved(degree) * turn;
                    range(1_000 + way * mm, 400 + way * root * 20)
                }
                false => no_range(0x25),
            })
        })
    };
    let expected = [
        (distances as Figures, (1, 0), [0, 1, 2, 3]),
        (strengths, (0, 1), [1, 2, 0, 3]),
    ];
    for (figures, (mm, root), order) in expected {
        let found = figures(&window(34, mm, root), &round());
        let by_hand = [1.0 / 3.0, (2.0_f64 / 3.0).sqrt(), 1.0 / 3.0, 47.0 / 48.0];
        let by_hand = order.map(|place| by_hand[place]);
        assert_eq!(found.len(), 4);
        for (found, by_hand) in found.iter().zip(by_hand) {
            assert!((found - by_hand).abs() < 1e-12, "{found} {by_hand}");
        }
        assert!(figures(&window(33, mm, root), &round()).is_empty());
    }
}

/// 356 degrees are examined. Four degrees have a code, two of them 0x21. These and the four
/// neighbours of each do not count as wall: 340 of 360 are left. Of 34 degrees with a distance,
/// thirty are on a wall.
#[test]
fn codes_are_counted_by_hand() {
    let code = |degree| match degree {
        50 | 200 => no_range(0x21),
        100 => no_range(0x25),
        300 => no_range(0x35),
        _ => range(1_000, 400),
    };
    let found = codes(&[turn_of(code)], &round());
    assert_eq!(found, [2.0 / 356.0, 2.0 / 340.0]);
    let few = |valid: usize| {
        let turn = turn_of(|degree| match degree < valid {
            true => range(1_000, 400),
            false => no_range(0x25),
        });
        codes(&[turn], &round())
    };
    assert_eq!(few(34), [0.0, 0.0]);
    assert!(few(33).is_empty());
}

/// Thirty packets with a distance are enough. A turn with fewer than two speeds is not compared. By
/// hand, for the speeds 1, 3 and then 2, 6: the steps 2, -1 and 4 have the mean 5 / 3 and the
/// variance 38 / 9. A turn later the two teeth are faster by 1 and 3: a deviation of 1, and
/// neighbours are opposite.
#[test]
fn packets_and_speeds_of_a_window_by_hand() {
    let mut turn = Twin::new(Profile::Fw24, square()).turns(1, 1).remove(0);
    let is_range = |reading: &Reading| matches!(reading, Reading::Range { .. });
    turn.packets
        .retain(|packet| packet.readings().iter().any(is_range));
    turn.packets.truncate(30);
    assert_eq!(packets(core::slice::from_ref(&turn), &round()).len(), 3);
    turn.packets.truncate(29);
    assert!(packets(core::slice::from_ref(&turn), &round()).is_empty());

    let speeds = |speeds: &[f64]| Turn {
        speeds_rpm: speeds.to_vec(),
        ..turn_of(|_| no_range(0x25))
    };
    let found = tooth_speeds(&[speeds(&[1.0, 3.0]), speeds(&[2.0, 6.0])], &round());
    let by_hand = [(38.0_f64 / 9.0).sqrt(), 1.0, -0.5, 0.0];
    assert_eq!(found.len(), 4);
    for (found, by_hand) in found.iter().zip(by_hand) {
        assert!((found - by_hand).abs() < 1e-12, "{found} {by_hand}");
    }
    assert!(tooth_speeds(&[speeds(&[1.0]), speeds(&[2.0])], &round()).is_empty());
}
