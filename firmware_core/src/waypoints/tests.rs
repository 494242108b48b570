extern crate std;

use std::collections::BTreeSet;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;

fn sent(id: i16, x: i16) -> Sent {
    Sent {
        position_mm: [x, 0],
        id,
        ..Sent::default()
    }
}

fn ids(list: &Waypoints) -> Vec<i16> {
    list.all().iter().map(|waypoint| waypoint.id).collect()
}

/// Field defect NV-05: the 101st waypoint vanished without a word. Seed figure S9: 100 slots.
#[test]
fn the_101st_waypoint_is_refused_aloud() {
    let mut list = Waypoints::new();
    for x in 0..100 {
        assert_eq!(list.push([x, 0], 0), Ok(x));
    }
    assert_eq!(list.push([100, 0], 0), Err(WaypointError::Full));
    assert_eq!(list.all().len(), 100);
}

/// Field defect NV-03: removing the first or the last waypoint lost an end of the list.
#[test]
fn the_ends_can_be_removed() {
    let mut list = Waypoints::new();
    list.replace([sent(0, 1), sent(1, 2), sent(2, 3)].into_iter());
    assert!(list.remove(0).is_ok() && list.remove(2).is_ok());
    assert_eq!(ids(&list), [1]);
    assert_eq!(list.remove(2), Err(WaypointError::Unknown(2)));
}

/// Field defects PU-07 and PU-09: links to waypoints that do not exist, or in a ring, led the
/// fielded program into foreign memory.
#[test]
fn the_senders_links_are_not_followed() {
    let mut list = Waypoints::new();
    let linked = |id, previous, x| Sent {
        previous,
        ..sent(id, x)
    };
    list.replace([linked(1, -1, 10), linked(0, 1, 20), linked(7, 99, 30)].into_iter());
    let xs: Vec<i16> = list
        .all()
        .iter()
        .map(|waypoint| waypoint.position_mm[0])
        .collect();
    assert_eq!(xs, [10, 20, 30]);
    let previous: Vec<i16> = list.to_send().map(|sent| sent.previous).collect();
    assert_eq!(previous, [-1, 0, 1]);
}

/// Field defect PU-10: while the robot drove to the third waypoint, a list of one arrived, and the
/// robot drove to a freed slot.
#[test]
fn a_new_list_selects_its_own_target() {
    let mut list = Waypoints::new();
    list.replace([sent(0, 1), sent(1, 2), sent(2, 3)].into_iter());
    list.advance();
    list.advance();
    list.replace([sent(0, 500)].into_iter());
    assert_eq!(
        list.target().map(|waypoint| waypoint.position_mm),
        Some([500, 0])
    );
    list.replace([].into_iter());
    assert_eq!(list.target(), None);
}

#[test]
fn a_repeated_list_does_not_send_the_robot_back() {
    let mut list = Waypoints::new();
    let tour = [sent(0, 1), sent(1, 2), sent(2, 3)];
    list.replace(tour.into_iter());
    list.advance();
    list.replace(tour.into_iter());
    assert_eq!((list.reached(), ids(&list)), (1, Vec::from([0, 1, 2])));

    list.replace(tour.into_iter().chain([sent(3, 4)]));
    assert_eq!(list.target().map(|waypoint| waypoint.id), Some(1));

    list.replace([sent(0, 1), sent(1, 9)].into_iter());
    assert_eq!(
        list.target()
            .map(|waypoint| (waypoint.id, waypoint.position_mm[0])),
        Some((4, 9))
    );
}

/// A list that equals the beginning of a finished one is a new order. If such a list comes while
/// the longer one is driven, the waypoints behind it are removed, and the robot drives to the last
/// one left.
#[test]
fn a_finished_list_that_comes_again_is_driven_again() {
    let mut list = Waypoints::new();
    let target_x = |list: &Waypoints| list.target().map(|waypoint| waypoint.position_mm[0]);
    list.replace([sent(0, 1), sent(1, 2)].into_iter());
    list.advance();
    list.advance();
    assert_eq!(list.target(), None);
    list.replace([sent(0, 1), sent(1, 2)].into_iter());
    assert_eq!(list.target().map(|waypoint| waypoint.id), Some(0));
    list.advance();
    list.replace([sent(0, 1)].into_iter());
    assert_eq!(target_x(&list), Some(1));
    list.replace([sent(0, 1), sent(1, 2), sent(2, 3)].into_iter());
    list.advance();
    list.advance();
    list.replace([sent(0, 1), sent(1, 2)].into_iter());
    assert_eq!(target_x(&list), Some(2));
    list.advance();
    list.replace([sent(0, 1)].into_iter());
    assert_eq!(target_x(&list), Some(1));
    list.replace([].into_iter());
    assert_eq!(list.target(), None);
}

/// Field defect UI-05: the PC numbers its own waypoints from 0 and uses a number twice.
#[test]
fn a_number_that_comes_twice_is_given_once() {
    let mut list = Waypoints::new();
    list.replace([sent(0, 1)].into_iter());
    list.replace([sent(0, 1), sent(0, 1), sent(0, 2)].into_iter());
    assert_eq!(ids(&list), [0, 1, 2]);
}

#[test]
fn used_up_numbers_are_reported() {
    let mut list = Waypoints::new();
    list.next_id = Some(i16::MAX);
    assert_eq!(list.push([0; 2], 0), Ok(i16::MAX));
    assert_eq!(list.push([0; 2], 0), Err(WaypointError::NumbersUsedUp));
}

#[derive(Clone, Debug)]
enum Step {
    Push(i16),
    InsertAfter(usize, i16),
    Remove(usize),
    Advance,
    Clear,
    Replace(Vec<i16>),
}

/// The error of a refused waypoint, and the length of the full list.
const FULL: (WaypointError, usize) = (WaypointError::Full, CAPACITY);

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        6 => any::<i16>().prop_map(Step::Push),
        4 => (0_usize..120, any::<i16>()).prop_map(|(at, x)| Step::InsertAfter(at, x)),
        3 => (0_usize..120).prop_map(Step::Remove),
        2 => Just(Step::Advance),
        1 => Just(Step::Clear),
        1 => prop::collection::vec(any::<i16>(), 0..56).prop_map(Step::Replace),
    ]
}

proptest! {
    /// Seed figure S9: the list behaves as a plain vector, and no number is used twice.
    #[test]
    fn the_list_is_a_vector_whose_numbers_are_never_reused(
        steps in prop::collection::vec(step(), 0..150),
    ) {
        let mut list = Waypoints::new();
        let mut model: Vec<(i16, i16)> = Vec::new();
        let mut given = BTreeSet::new();
        for step in steps {
            match step {
                Step::Push(x) => match list.push([x, 0], 0) {
                    Ok(id) => { prop_assert!(given.insert(id)); model.push((id, x)); }
                    Err(error) => prop_assert_eq!((error, model.len()), FULL),
                },
                Step::InsertAfter(at, x) => if let Some(&(before, _)) = model.get(at) {
                    match list.insert_after(before, [x, 0], 0) {
                        Ok(id) => {
                            prop_assert!(given.insert(id));
                            model.insert(at + 1, (id, x));
                        }
                        Err(error) => prop_assert_eq!((error, model.len()), FULL),
                    }
                },
                Step::Remove(at) => if let Some(&(id, _)) = model.get(at) {
                    prop_assert!(list.remove(id).is_ok());
                    model.remove(at);
                },
                Step::Advance => list.advance(),
                Step::Clear => { list.clear(); model.clear(); }
                Step::Replace(xs) => {
                    // The numbers are not the robot's, so all waypoints are new.
                    prop_assert_eq!(list.replace(xs.iter().map(|&x| sent(-2, x))), 0);
                    model = list.all().iter().map(|waypoint| waypoint.id).zip(xs).collect();
                    for (id, _) in &model { prop_assert!(given.insert(*id)); }
                }
            }
            let seen = |waypoint: &Waypoint| (waypoint.id, waypoint.position_mm[0]);
            let held: Vec<_> = list.all().iter().map(seen).collect();
            prop_assert_eq!(&held, &model);
            prop_assert!(list.reached() <= model.len());
        }
    }
}

/// The fielded program: two waypoints behind the same one lead to a freed object, one behind an
/// unknown one leads to a null pointer.
#[test]
fn links_of_the_sender_break_the_fielded_list() {
    let list = |links: &[i16], defects: Defects| {
        let mut waypoints = Waypoints::with_defects(defects);
        let sent = (0..).zip(links).map(|(id, &previous)| Sent {
            position_mm: [0; 2],
            layer: 0,
            id,
            previous,
        });
        waypoints.replace(sent);
        (waypoints.is_dead(), waypoints.stray_writes().count)
    };
    let shared = Defects {
        follows_shared_links: true,
        ..Defects::NONE
    };
    let unknown = Defects {
        follows_unknown_links: true,
        ..Defects::NONE
    };
    assert_eq!(list(&[-1, 0, 0], shared), (false, 1));
    assert_eq!(list(&[-1, 0, 1], shared), (false, 0));
    assert_eq!(list(&[-1, 7], unknown), (true, 0));
    assert_eq!(list(&[-1, 0, 1], unknown), (false, 0));
    assert_eq!(list(&[-1, 7, 0, 0], Defects::NONE), (false, 0));
}

/// Of 103 waypoints three find no slot. If only one number is left, one of two waypoints gets none.
#[test]
fn what_of_a_list_finds_no_room_is_told() {
    let mut list = Waypoints::new();
    let many = (0..103).map(|x| sent(-5, x));
    assert_eq!(
        (list.replace(many), list.count(), list.is_empty()),
        (3, 100, false)
    );
    assert_eq!((list.replace(core::iter::empty()), list.count()), (0, 0));
    list.next_id = Some(i16::MAX);
    let two = [sent(-5, 1), sent(-5, 2)];
    assert_eq!(
        (list.replace(two.into_iter()), ids(&list)),
        (1, [i16::MAX].to_vec())
    );
}

/// A list that has lost its first waypoint still counts waypoints that it cannot reach.
#[test]
fn a_broken_list_counts_more_than_it_reaches() {
    let mut list = Waypoints::with_defects(Defects {
        loses_its_ends: true,
        ..Defects::NONE
    });
    (0..3).for_each(|x| _ = list.push([x, 0], 0));
    assert_eq!((list.count(), list.all().len()), (3, 3));
    list.remove(0).expect("it is there");
    assert_eq!((list.count(), list.all().len()), (2, 0));
}

/// NV-03: a list that has lost the last waypoint has no end to append another one to; the removal
/// of a middle one keeps the end.
#[test]
fn a_list_without_its_end_takes_no_more() {
    let count = |removed: i16| {
        let mut list = Waypoints::with_defects(Defects {
            loses_its_ends: true,
            ..Defects::NONE
        });
        (0..3).for_each(|x| _ = list.push([x, 0], 0));
        list.remove(removed).expect("it is there");
        list.push([9, 0], 0).expect("without a word");
        (list.count(), list.all().len())
    };
    assert_eq!([0, 1, 2].map(count), [(3, 0), (3, 3), (2, 2)]);
}

#[test]
fn only_the_end_of_a_list_is_its_last_target() {
    let mut list = Waypoints::new();
    list.replace([sent(0, 1), sent(1, 2), sent(2, 3)].into_iter());
    let mut last = || {
        let is_last = list.is_last();
        list.advance();
        is_last
    };
    assert_eq!([0; 4].map(|_| last()), [false, false, true, false]);
}
