use super::super::compare::{PAIR, SIDE};
use super::*;

fn input(bytes: &[u8]) -> Input {
    Input(vec![Hex(bytes.to_vec())])
}

fn due(bytes: &[u8]) -> Due {
    let (input, rank) = (input(bytes), bytes.len() as u64);
    let depth = 0;
    Due { input, depth, rank }
}

fn guided(parts: &[&[u8]]) -> Guided {
    Guided {
        stream: String::new(),
        parts: parts.iter().map(|part| (due(part), false)).collect(),
    }
}

/// In these tests marks are locations, each reached once.
fn reached(marks: &[u32]) -> Reached {
    Reached {
        marks: marks.iter().map(|mark| mark * SIZES + 1).collect(),
        compared: Vec::new(),
    }
}

/// The second part is the first to reach mark 2; the third reaches nothing new, the fourth was not
/// sent. The part before the second is kept with it; a later try shows whether it was needed.
#[test]
fn what_reached_something_new_is_kept_with_what_was_told_before() {
    let mut guide = Guide::default();
    let reached = [reached(&[1]), reached(&[1, 2]), reached(&[2])];
    guide.learn(
        &Speech::Bytes,
        guided(&[&[1], &[2], &[3], &[4]]),
        &reached,
        false,
    );
    let second = Input(vec![Hex(vec![1]), Hex(vec![2])]);
    assert_eq!(guide.pool[&0], input(&[1]));
    // One byte is shorter than two.
    assert_eq!(guide.pool[&guide.marks[&(2 * SIZES + 1)].0], input(&[3]));
    assert!(!guide.pool.values().any(|kept| *kept == second));
    assert_eq!(guide.due[0].input, input(&[2]));
    assert_eq!(guide.due.len(), 1);
    assert_eq!(
        (guide.marks[&(SIZES + 1)].1, guide.marks[&(2 * SIZES + 1)].1),
        (2, 2)
    );
}

/// Two bytes reach marks 1 and 2, one byte reaches mark 1: both inputs stay. Another single byte
/// reaches mark 2, which makes the two bytes redundant.
#[test]
fn of_two_that_reach_the_same_the_shorter_is_kept() {
    let mut guide = Guide::default();
    assert!(guide.keep(&input(&[7, 7]), &[], &[16, 32]));
    assert!(!guide.keep(&input(&[8]), &[], &[16]));
    assert_eq!(guide.pool.len(), 2);
    assert!(!guide.keep(&input(&[9]), &[], &[32]));
    assert!(!guide.pool.values().any(|kept| kept.size() == 2));
    // A new count is not a new location, but is kept.
    assert!(!guide.keep(&input(&[7, 7, 7]), &[], &[33]));
    assert!(guide.pool.values().any(|kept| kept.size() == 3));
}

/// The program ended in the second of three parts. That part is not sent again; the third, which
/// was queued, stays queued.
#[test]
fn what_ends_the_program_is_not_kept_and_what_came_after_it_is_still_due() {
    let mut guide = Guide {
        due: vec![due(&[2]), due(&[3])],
        ..Guide::default()
    };
    let mut played = guided(&[&[1], &[2], &[3]]);
    (played.parts[1].1, played.parts[2].1) = (true, true);
    guide.learn(
        &Speech::Bytes,
        played,
        &[reached(&[1]), reached(&[5])],
        true,
    );
    assert_eq!(guide.due, [due(&[3])]);
    assert!(!guide.marks.contains_key(&(5 * SIZES + 1)));
}

/// Byte 41 is compared with 51 at location 3: the variant is queued before the longer inputs.
#[test]
fn a_comparison_is_answered() {
    let mut pair = [0; PAIR];
    (pair[0], pair[4], pair[8], pair[8 + SIDE]) = (3, 1, 0x41, 0x51);
    let compared = vec![Comparison::read(&pair).expect("one")];
    let marks = vec![1];
    let mut guide = Guide {
        due: vec![due(&[9; 20])],
        ..Guide::default()
    };
    guide.learn(
        &Speech::Bytes,
        guided(&[b"AB"]),
        &[Reached { marks, compared }],
        false,
    );
    assert_eq!(guide.due[0].input, input(b"QB"));
    assert_eq!(guide.due.last(), Some(&due(&[9; 20])));
    assert_eq!(guide.answered, BTreeMap::from([(3, 1)]));
}

#[test]
fn traffic_is_the_same_for_the_same_seed_and_made_of_what_is_kept_and_due() {
    let mut guide = Guide {
        due: vec![due(b"due")],
        ..Guide::default()
    };
    guide.keep(&input(&[0xA5; 40]), &[], &[1]);
    let make = |seed| {
        let rng = &mut Rng::stream(seed, "test");
        guide.traffic(&Speech::Bytes, 1000.0, rng)
    };
    assert_eq!(make(1).stream, make(1).stream);
    assert_ne!(make(1).stream, make(2).stream);
    assert!(make(1).stream.contains("A5 A5 A5 A5 A5 A5"));
    let is_due = |guided: Guided| guided.parts.iter().filter(|part| part.1).count();
    assert_eq!(is_due(make(1)), 1);
    let pauses = make(1)
        .stream
        .lines()
        .filter(|line| *line == "idle")
        .count();
    assert_eq!(pauses, make(1).parts.len());
}
