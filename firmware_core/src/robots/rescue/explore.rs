//! Autonomous search of the maze and return home, as the report promises.
//!
//! ```text
//! seeks: view -> way -> look round -> next view ... nothing left -> goes home -> is home
//! ```
//!
//! The robot drops a view as soon as its target is seen, mostly on the path to it. It gives a view
//! up if the drive takes much longer than the path's length, or if the robot makes no progress.
//! Before the search ends, all given-up views get one more chance, because a moving obstacle may
//! have blocked the path.

use core::f32::consts::FRAC_PI_2;

use crate::grid::Grid;
use crate::navigation::{
    Body, Frontiers, Goal, HALT, Navigator, Outlook, Sought, Step, Surroundings, View,
};
use crate::pose::{Point, Pose, normalised};

/// Scans after which the view is judged again: a second.
const JUDGE_SCANS: u8 = 5;
/// Number of views in a row that each add fewer cells than the second figure, 0.02 m2. After them
/// only large views are tried, after twice as many only unfelt walls, and after three times as many
/// no view. The rest is noise of the map, not floor.
const VAIN_VIEWS: u8 = 6;
const NEWS_CELLS: u32 = 25;
/// Minimum number of known cells of a map: the floor under the robot, 0.08 m2.
const FOOTPRINT_CELLS: u32 = 90;
/// Minimum number of new cells of a view that showed something.
const NOTHING_CELLS: u32 = 3;
/// Scans for which the robot stays at a view.
const LOOK_SCANS: u8 = 4;
/// Maximum number of scans for a path: 20 s, plus the path's length at 13 cm/s, plus ten seconds if
/// the robot is nearly there.
const PATIENCE_SCANS: u16 = 100;
const PATIENCE_PER_CELL: u16 = 2;
const NEARLY_SCANS: u16 = 50;
const NEARLY_MM: f32 = 500.0;
/// Minimum progress towards a view, millimetres, within 75 scans (15 s). A robot below it is stuck
/// and gives the view up.
const SHUFFLE_MM: f32 = 300.0;
const SHUFFLE_SCANS: u8 = 75;
/// Two views no farther apart than this, millimetres, serve the same walls: both feel walls 0.42 m
/// away.
const SAME_WALLS_MM: f32 = 500.0;
/// Speed of the wheels in a turn on the spot that shows the walls to the heat sensors: 45 degrees a
/// second.
const TURN: i8 = 9;
/// Turn on the spot, radians: both sides together see everything in half a turn.
const TURN_RAD: f32 = 3.4;

/// Angle from the middle of a heat sensor's view, relative to the robot's middle, within which a
/// wall counts as felt. A plate of 10 cm there fills a fifth of the view.
const FELT_RAD: f32 = 0.16;

/// Progress of the search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The robot searches unknown areas.
    Seeks,
    /// No reachable area is unknown: the robot drives home.
    GoesHome,
    /// The robot is home.
    IsHome,
}

/// Position near which the robot has stayed, and for how many scans.
#[derive(Clone, Copy, Debug)]
struct Shuffle {
    about: Point,
    scans: u8,
}

impl Shuffle {
    const fn at(about: Point) -> Self {
        Self { about, scans: 0 }
    }

    fn after(self, place: Point) -> Self {
        if self.about.distance_mm(place) > SHUFFLE_MM {
            return Self::at(place);
        }
        let scans = self.scans.saturating_add(1);
        Self { scans, ..self }
    }
}

/// Current action at a view.
#[derive(Clone, Copy, Debug)]
enum At {
    /// Driving to the view.
    Way {
        view: View,
        scans: u16,
        age: u8,
        shuffle: Shuffle,
    },
    /// Standing and looking.
    Look { place: Point, scans: u8 },
    /// Turning on the spot; `turned` radians of it are done since `heading`.
    Turn {
        place: Point,
        heading: f32,
        turned: f32,
    },
}

/// The robot's knowledge and scan for a decision.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight<'a> {
    pub(super) map: &'a Grid,
    pub(super) pose: Pose,
    pub(super) around: &'a Surroundings,
    /// Whether the heat sensors, left and right, feel no victim, or only known ones.
    pub(super) is_felt: [bool; 2],
}

/// The search of the maze.
#[derive(Clone, Debug)]
pub(super) struct Explore {
    progress: Progress,
    sought: Sought,
    home: Option<Point>,
    frontiers: Frontiers,
    at: Option<At>,
    /// Whether the given-up views have had their second chance.
    is_second: bool,
    views: u16,
    /// Cells known at the last view that added some, and views since.
    known: u32,
    vain: u8,
    /// The last view, and the number of cells known at its choice.
    last: Option<(Point, u32)>,
    /// The last view that the robot did not reach.
    unreached: Option<Point>,
}

impl Explore {
    pub(super) const fn new(sought: Sought) -> Self {
        Self {
            progress: Progress::Seeks,
            sought,
            home: None,
            frontiers: Frontiers::new(sought),
            at: None,
            is_second: false,
            views: 0,
            known: 0,
            vain: 0,
            last: None,
            unreached: None,
        }
    }

    /// Whether a search was ever ordered.
    pub(super) const fn has_begun(&self) -> bool {
        self.home.is_some()
    }

    pub(super) const fn progress(&self) -> Progress {
        self.progress
    }

    /// Number of views that the robot has looked from.
    pub(super) const fn views(&self) -> u16 {
        self.views
    }

    /// Interrupts the search, which continues from the robot's later position, because the
    /// surroundings may have changed. A finished search starts again.
    pub(super) const fn pause(&mut self) {
        self.at = None;
        if matches!(self.progress, Progress::IsHome) {
            self.progress = Progress::Seeks;
            self.home = None;
            self.is_second = false;
            self.vain = 0;
        }
    }

    /// Sends the robot home, even if unknown areas remain: to the start of its search, or else to
    /// `start`.
    pub(super) fn go_home(&mut self, start: Point) {
        self.home.get_or_insert(start);
        self.progress = Progress::GoesHome;
        self.at = None;
    }

    /// Computing since the last call, in points of candidate poses.
    pub(super) const fn take_points(&mut self) -> u32 {
        self.frontiers.take_points()
    }

    /// Updates the felt walls with the heat sensors' readings at `pose`; a warm wall beside the
    /// robot without a known victim stays unfelt.
    fn feel(
        &mut self,
        Sight {
            map, pose, is_felt, ..
        }: Sight<'_>,
    ) {
        let sides = [FRAC_PI_2, -FRAC_PI_2].into_iter().zip(is_felt);
        let sides = sides.filter(|(_, is_felt)| *is_felt).map(|(side, _)| side);
        let beside = |side| {
            [-1.0, -0.5, 0.0, 0.5, 1.0].map(|beside| pose.heading + side + FELT_RAD * beside)
        };
        let bearings = sides.flat_map(beside);
        self.frontiers.feel(map, pose.position(), bearings);
    }

    /// Runs one step of the search, once a scan.
    pub(super) fn step(&mut self, navigator: &mut Navigator, sight: Sight<'_>) -> [i8; 2] {
        if self.sought == Sought::FloorAndHeat {
            self.feel(sight);
        }
        let home = *self.home.get_or_insert(sight.pose.position());
        match self.progress {
            Progress::Seeks => self.seek(navigator, sight),
            Progress::GoesHome => {
                let goal = Goal {
                    position: home,
                    is_last: true,
                };
                match navigator.approach(sight.map, sight.pose, goal, sight.around) {
                    Step::Drive(set_point) => set_point,
                    Step::Arrived => {
                        self.progress = Progress::IsHome;
                        HALT
                    }
                }
            }
            Progress::IsHome => HALT,
        }
    }

    fn seek(&mut self, navigator: &mut Navigator, sight: Sight<'_>) -> [i8; 2] {
        match self.at {
            None => self.choose(navigator.settings().body, sight),
            Some(At::Way {
                view,
                scans,
                age,
                shuffle,
            }) => self.go(navigator, sight, (view, shuffle), [scans, age.into()]),
            Some(At::Look { place, scans }) => self.look(sight, place, scans),
            Some(At::Turn {
                place,
                heading,
                turned,
            }) => {
                let body = &navigator.settings().body;
                self.turn(body, sight, place, [heading, turned])
            }
        }
    }

    /// Minimum number of unknown cells that justify a path after so many views in vain; `None`
    /// after too many.
    const fn least(&self) -> Option<u16> {
        if self.vain <= VAIN_VIEWS {
            Some(Outlook::SMALL)
        } else if self.vain <= 2 * VAIN_VIEWS {
            Some(Outlook::LARGE)
        } else if self.vain <= 3 * VAIN_VIEWS {
            Some(Outlook::NEVER)
        } else {
            None
        }
    }

    fn choose(&mut self, body: Body, sight: Sight<'_>) -> [i8; 2] {
        let Sight {
            map, pose, around, ..
        } = sight;
        let known = self.frontiers.known_cells(map);
        if known >= self.known.saturating_add(NEWS_CELLS) {
            (self.known, self.vain) = (known, 0);
        } else {
            self.vain = self.vain.saturating_add(1);
        }
        if let Some((place, before)) = self.last.take()
            && known < before.saturating_add(NOTHING_CELLS)
        {
            self.frontiers.showed_nothing(map, place);
        }
        if known < FOOTPRINT_CELLS {
            // In an unknown map no view can be chosen: the lidar must see something first.
            (self.vain, self.is_second) = (0, false);
            return HALT;
        }
        let Some(least) = self.least() else {
            self.progress = Progress::GoesHome;
            return HALT;
        };
        match self.frontiers.next_view(map, (&body, least), pose, around) {
            Some(view) => {
                self.views = self.views.saturating_add(1);
                self.last = Some((view.place, known));
                self.at = Some(At::Way {
                    view,
                    scans: 0,
                    age: 0,
                    shuffle: Shuffle::at(pose.position()),
                });
            }
            None if !self.is_second => {
                self.is_second = true;
                self.frontiers.forgive();
            }
            None => self.progress = Progress::GoesHome,
        }
        HALT
    }

    fn go(
        &mut self,
        navigator: &mut Navigator,
        sight: Sight<'_>,
        (view, shuffle): (View, Shuffle),
        [scans, age]: [u16; 2],
    ) -> [i8; 2] {
        let Sight {
            map, pose, around, ..
        } = sight;
        let is_nearly_there = pose.position().distance_mm(view.place) < NEARLY_MM;
        let patience = PATIENCE_SCANS
            .saturating_add(view.way_cells.saturating_mul(PATIENCE_PER_CELL))
            .saturating_add(if is_nearly_there { NEARLY_SCANS } else { 0 });
        let shuffle = shuffle.after(pose.position());
        if scans > patience || shuffle.scans > SHUFFLE_SCANS {
            return self.cannot_reach(map, view.place);
        }
        let is_due = age >= JUDGE_SCANS.into();
        if is_due && !self.frontiers.outlook(map, view.place).is_worth_a_way() {
            return self.choose(navigator.settings().body, sight);
        }
        let goal = Goal {
            position: view.place,
            is_last: false,
        };
        let step = navigator.approach(map, pose, goal, around);
        if navigator.has_no_way() {
            return self.cannot_reach(map, view.place);
        }
        let (next, set_point) = match step {
            Step::Drive(set_point) => {
                let age = if is_due { 0 } else { age.saturating_add(1) };
                let at = At::Way {
                    view,
                    scans: scans + 1,
                    age: u8::try_from(age).unwrap_or(u8::MAX),
                    shuffle,
                };
                (at, set_point)
            }
            Step::Arrived => {
                let place = view.place;
                (At::Look { place, scans: 0 }, HALT)
            }
        };
        self.at = Some(next);
        set_point
    }

    /// Gives up the targets seen from `place`, and rejects positions beside it: from afar the map
    /// shows a path there again and again. The walls may still be felt from another position,
    /// unless this was already the second one.
    fn cannot_reach(&mut self, map: &Grid, place: Point) -> [i8; 2] {
        let before = self.unreached.replace(place);
        let sought = match before.is_some_and(|before| before.distance_mm(place) < SAME_WALLS_MM) {
            true => Sought::FloorAndHeat,
            false => Sought::Floor,
        };
        self.frontiers.give_up(map, place, sought);
        self.frontiers.showed_nothing(map, place);
        self.at = None;
        HALT
    }

    fn look(&mut self, sight: Sight<'_>, place: Point, scans: u8) -> [i8; 2] {
        let outlook = self.frontiers.outlook(sight.map, place);
        self.at = if !outlook.is_worth_a_way() {
            None
        } else if outlook.is_to_be_felt() {
            let heading = sight.pose.heading;
            Some(At::Turn {
                place,
                heading,
                turned: 0.0,
            })
        } else if scans < LOOK_SCANS {
            let scans = scans + 1;
            Some(At::Look { place, scans })
        } else {
            self.frontiers.give_up(sight.map, place, self.sought);
            None
        };
        HALT
    }

    fn turn(
        &mut self,
        body: &Body,
        sight: Sight<'_>,
        place: Point,
        [heading, turned]: [f32; 2],
    ) -> [i8; 2] {
        let turned = turned + normalised(sight.pose.heading - heading).abs();
        let outlook = self.frontiers.outlook(sight.map, place);
        if !outlook.is_to_be_felt() || turned >= TURN_RAD {
            if outlook.is_to_be_felt() {
                self.frontiers.give_up(sight.map, place, self.sought);
            }
            self.at = None;
            return HALT;
        }
        self.at = Some(At::Turn {
            place,
            heading: sight.pose.heading,
            turned,
        });
        sight.around.guarded(body, [-TURN, TURN])
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::navigation::Settings;

    /// Until the lidar has shown something, the search waits; an empty map does not mean a complete
    /// one. A known room without an exit does.
    #[test]
    fn a_search_without_a_map_waits() {
        let body = Body {
            radius_mm: 160.0,
            clearance_mm: 45.0,
            tick_mm_s: 11.345,
            axle_mm: 260.0,
        };
        let mut navigator = Navigator::new(Settings::new(body));
        let mut explore = Explore::new(Sought::Floor);
        let mut map = std::boxed::Box::new(Grid::new(10.0));
        let mut step = |map: &Grid| {
            let sight = Sight {
                map,
                pose: Pose::new(900.0, 900.0, 0.0),
                around: &Surroundings::EMPTY,
                is_felt: [true; 2],
            };
            assert_eq!(explore.step(&mut navigator, sight), HALT);
            explore.progress()
        };
        assert!((0..100).all(|_| step(&map) == Progress::Seeks));
        for (x, y) in (27..=152).flat_map(|x| (27..=152).map(move |y| (x, y))) {
            let is_inside = (30..150).contains(&x) && (30..150).contains(&y);
            map.set(x, y, if is_inside { 0 } else { 255 });
        }
        assert!((0..10).any(|_| step(&map) != Progress::Seeks));
    }

    const BODY: Body = Body {
        radius_mm: 160.0,
        clearance_mm: 45.0,
        tick_mm_s: 11.345,
        axle_mm: 260.0,
    };

    /// A known room from 0.3 m to 1.5 m; if `is_open`, its right wall has a door of 0.6 m.
    fn room(is_open: bool) -> std::boxed::Box<Grid> {
        let mut map = std::boxed::Box::new(Grid::new(10.0));
        for (x, y) in (27..=152).flat_map(|x| (27..=152).map(move |y| (x, y))) {
            let is_inside = (30..150).contains(&x) && (30..150).contains(&y);
            let is_door = is_open && x >= 150 && (60..120).contains(&y);
            map.set(x, y, if is_inside || is_door { 0 } else { 255 });
        }
        map
    }

    /// One step of a standing robot; the heat sensors feel nothing, and the lidar sees distant
    /// walls all around.
    fn step(explore: &mut Explore, map: &Grid, pose: Pose) -> [i8; 2] {
        let seen = (0..60_u8).map(|index| {
            let (sin, cos) = crate::pose::sin_cos(f32::from(index) * 0.1);
            Point::new(3_000.0 * cos, 3_000.0 * sin)
        });
        let sight = Sight {
            map,
            pose,
            around: &Surroundings::of(seen),
            is_felt: [false; 2],
        };
        explore.step(&mut Navigator::new(Settings::new(BODY)), sight)
    }

    const MIDDLE: Pose = Pose {
        x_mm: 900.0,
        y_mm: 900.0,
        heading: 0.0,
    };

    /// Up to six views in vain everything counts, up to twelve only large views, up to eighteen
    /// only heat.
    #[test]
    fn after_views_in_vain_less_is_worth_a_way() {
        let mut explore = Explore::new(Sought::Floor);
        let least = [0, 6, 7, 12, 13, 18, 19].map(|vain| {
            explore.vain = vain;
            explore.least()
        });
        let expected = [
            Some(6),
            Some(6),
            Some(30),
            Some(30),
            Some(u16::MAX),
            Some(u16::MAX),
            None,
        ];
        assert_eq!(least, expected);
    }

    /// 25 new cells of 30 mm since the last view that added some count as news.
    #[test]
    fn twenty_five_cells_are_news() {
        let map = room(false);
        let known = Explore::new(Sought::Floor).frontiers.known_cells(&map);
        let vain = |before: u32| {
            let mut explore = Explore::new(Sought::Floor);
            (explore.known, explore.vain) = (known - before, 3);
            step(&mut explore, &map, MIDDLE);
            (explore.vain, explore.known == known)
        };
        assert_eq!([24, 25].map(vain), [(4, false), (0, true)]);
    }

    /// Ninety known cells, nine by ten, are the floor under the robot; with fewer there is no map
    /// yet.
    #[test]
    fn ninety_cells_are_a_map() {
        let seconds = [90, 89].map(|cells: usize| {
            let mut map = std::boxed::Box::new(Grid::new(10.0));
            for cell in 0..cells {
                let (x, y) = (30 + cell % 10, 30 + cell / 10);
                let fine = (0..9).map(|fine| (3 * x + fine % 3, 3 * y + fine / 3));
                fine.for_each(|(x, y)| map.set(x, y, 0));
            }
            let mut explore = Explore::new(Sought::Floor);
            (explore.vain, explore.known) = (9, 1_000);
            step(&mut explore, &map, Pose::new(1_000.0, 1_000.0, 0.0));
            explore.vain
        });
        assert_eq!(seconds, [10, 0]);
    }

    fn on_the_way(x_mm: f32, way_cells: u16, scans: u16, age: u8) -> Explore {
        let mut explore = Explore::new(Sought::Floor);
        let place = Point::new(x_mm, 900.0);
        let view = View { place, way_cells };
        explore.at = Some(At::Way {
            view,
            scans,
            age,
            shuffle: Shuffle::at(MIDDLE.position()),
        });
        explore
    }

    /// A robot may stay within 300 mm for 75 scans; with the 76th it gives up. A robot
    /// that has moved farther continues.
    #[test]
    fn who_shuffles_before_a_view_for_15_seconds_gives_it_up() {
        let map = room(true);
        let stayed = |scans, mm| {
            let mut explore = on_the_way(1_400.0, 100, 80, 0);
            let Some(At::Way { shuffle, .. }) = &mut explore.at else {
                panic!("is on its way");
            };
            let here = MIDDLE.position();
            let about = Point::new(here.x_mm - mm, here.y_mm);
            *shuffle = Shuffle { about, scans };
            step(&mut explore, &map, MIDDLE);
            match explore.at {
                Some(At::Way { shuffle, .. }) => Some(shuffle.scans),
                _ => None,
            }
        };
        assert_eq!([stayed(74, 299.0), stayed(75, 299.0)], [Some(75), None]);
        assert_eq!([stayed(75, 300.0), stayed(75, 301.0)], [None, Some(0)]);
    }

    /// A path of 10 cells may take 100 scans and two for each cell, and 50 more as soon as less
    /// than half a metre remains.
    #[test]
    fn a_way_that_takes_too_long_is_given_up() {
        let map = room(true);
        let after = |x_mm, scans| {
            let mut explore = on_the_way(x_mm, 10, scans, 0);
            step(&mut explore, &map, MIDDLE);
            explore.at
        };
        assert!(matches!(
            after(1_400.0, 120),
            Some(At::Way {
                scans: 121,
                age: 1,
                ..
            })
        ));
        assert!(after(1_400.0, 121).is_none());
        assert!(after(1_399.0, 170).is_some() && after(1_399.0, 171).is_none());
    }

    /// Each fifth scan the view is judged again: behind an open door it still shows unknown cells,
    /// in a closed room none.
    #[test]
    fn a_view_is_judged_again_each_second() {
        let after = |map: &Grid, age| {
            let mut explore = on_the_way(1_200.0, 10, 7, age);
            step(&mut explore, map, MIDDLE);
            explore.at
        };
        let (open, closed) = (room(true), room(false));
        assert!(matches!(
            after(&closed, 4),
            Some(At::Way {
                scans: 8,
                age: 5,
                ..
            })
        ));
        // The search chooses another view, but there is none.
        assert!(matches!(after(&closed, 5), Some(At::Way { scans: 7, .. })));
        let mut explore = on_the_way(1_200.0, 10, 7, 5);
        explore
            .frontiers
            .next_view(&open, (&BODY, Outlook::SMALL), MIDDLE, &Surroundings::EMPTY);
        assert!(step(&mut explore, &open, MIDDLE) != HALT);
        assert!(matches!(
            explore.at,
            Some(At::Way {
                scans: 8,
                age: 0,
                ..
            })
        ));
    }

    /// At its view the robot stands for four scans while the view still shows something, then it
    /// gives the view up.
    #[test]
    fn the_robot_looks_for_a_second_where_it_has_arrived() {
        let (open, closed) = (room(true), room(false));
        let there = Pose::new(1_200.0, 900.0, 0.0);
        let mut explore = on_the_way(1_200.0, 10, 7, 0);
        explore
            .frontiers
            .next_view(&open, (&BODY, Outlook::SMALL), there, &Surroundings::EMPTY);
        for expected in 0..=4 {
            assert_eq!(step(&mut explore, &open, there), HALT);
            assert!(matches!(explore.at, Some(At::Look { scans, .. }) if scans == expected));
        }
        let is_worth = |explore: &mut Explore| {
            let outlook = explore.frontiers.outlook(&open, there.position());
            outlook.is_worth_a_way()
        };
        assert!(is_worth(&mut explore));
        assert_eq!(step(&mut explore, &open, there), HALT);
        assert!(explore.at.is_none() && !is_worth(&mut explore));
        let place = there.position();
        explore.at = Some(At::Look { place, scans: 0 });
        step(&mut explore, &closed, there);
        assert!(explore.at.is_none());
    }

    /// Beside a wall that its heat sensors have not passed, the robot turns on the spot, slightly
    /// more than half a turn. Walls that are still unfelt are then given up.
    #[test]
    fn the_robot_turns_before_walls_that_it_has_not_felt() {
        let map = room(false);
        let place = Point::new(520.0, 900.0);
        let mut explore = Explore::new(Sought::FloorAndHeat);
        explore.at = Some(At::Look { place, scans: 0 });
        let mut turn = |heading| {
            let set_point = step(&mut explore, &map, Pose::new(520.0, 900.0, heading));
            let turned = match explore.at {
                Some(At::Turn { turned, .. }) => turned,
                _ => -1.0,
            };
            (set_point, turned)
        };
        assert_eq!(turn(0.5), (HALT, 0.0));
        for (heading, expected) in [(1.5, 1.0), (1.0, 1.5), (2.8, 3.3), (2.8, 3.3)] {
            let (set_point, turned) = turn(heading);
            assert!(
                set_point == [-9, 9] && (turned - expected).abs() < 1e-5,
                "{turned}"
            );
        }
        assert_eq!(turn(2.91), (HALT, -1.0));
        assert!(!explore.frontiers.outlook(&map, place).is_to_be_felt());
        // The turn also ends if all walls have been felt.
        explore.at = Some(At::Turn {
            place,
            heading: 0.0,
            turned: 0.0,
        });
        assert_eq!(step(&mut explore, &map, Pose::new(520.0, 900.0, 0.1)), HALT);
        assert!(explore.at.is_none());
    }

    /// Both heat sensors point sideways: they feel neither cold nor warm walls ahead.
    #[test]
    fn only_what_lies_beside_is_felt() {
        let map = room(false);
        let unfelt = |heading, is_felt| {
            let mut explore = Explore::new(Sought::FloorAndHeat);
            let pose = Pose::new(520.0, 900.0, heading);
            let before = explore.frontiers.outlook(&map, pose.position()).unfelt;
            explore.feel(Sight {
                map: &map,
                pose,
                around: &Surroundings::EMPTY,
                is_felt,
            });
            before - explore.frontiers.outlook(&map, pose.position()).unfelt
        };
        assert_eq!(unfelt(0.0, [true; 2]), 0);
        // Turned to the right, the left sensor faces the room and the right one the wall behind.
        assert_eq!(unfelt(-FRAC_PI_2, [true, false]), 0);
        assert!(unfelt(-FRAC_PI_2, [false, true]) > 0);
        assert!(unfelt(FRAC_PI_2, [true, false]) > 0);
        assert_eq!(unfelt(FRAC_PI_2, [false, true]), 0);
    }

    /// Home is the start of the search, or the given position if no search was started.
    #[test]
    fn the_robot_goes_home_to_where_it_began() {
        let map = room(false);
        let mut explore = Explore::new(Sought::Floor);
        assert!(!explore.has_begun());
        explore.at = Some(At::Look {
            place: MIDDLE.position(),
            scans: 0,
        });
        explore.go_home(Point::new(500.0, 900.0));
        assert!(explore.has_begun() && explore.at.is_none());
        assert!(step(&mut explore, &map, MIDDLE) != HALT);
        assert_eq!(explore.progress(), Progress::GoesHome);
        explore.pause();
        assert_eq!(
            (explore.progress(), explore.has_begun()),
            (Progress::GoesHome, true)
        );
        assert_eq!(step(&mut explore, &map, Pose::new(500.0, 900.0, 0.0)), HALT);
        assert_eq!(explore.progress(), Progress::IsHome);
        assert_eq!(step(&mut explore, &map, MIDDLE), HALT);
        (explore.vain, explore.is_second) = (5, true);
        explore.pause();
        assert_eq!(
            (explore.progress(), explore.has_begun()),
            (Progress::Seeks, false)
        );
        assert_eq!((explore.vain, explore.is_second), (0, false));
        step(&mut explore, &map, MIDDLE);
        explore.go_home(Point::new(500.0, 900.0));
        assert_eq!(explore.home, Some(MIDDLE.position()));
    }

    /// Walls nearer than half a metre to another unreached view are also given up.
    #[test]
    fn walls_are_given_up_beside_a_place_that_was_not_reached() {
        let map = room(false);
        let unfelt = |places: &[f32]| {
            let mut explore = Explore::new(Sought::FloorAndHeat);
            for x_mm in places {
                let place = Point::new(*x_mm, 900.0);
                assert_eq!(explore.cannot_reach(&map, place), HALT);
            }
            explore
                .frontiers
                .outlook(&map, Point::new(500.0, 900.0))
                .unfelt
        };
        let all = unfelt(&[]);
        assert!(all > 0);
        assert_eq!([unfelt(&[500.0]), unfelt(&[1_000.0, 500.0])], [all; 2]);
        assert!(unfelt(&[999.0, 500.0]) < all && unfelt(&[500.0, 500.0]) < all);
    }
}
