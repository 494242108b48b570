//! Exploration: look, enter the scan into the map, choose the next view, drive a stretch of the
//! path there, until no view is left.

use alloc::collections::{BTreeMap, BTreeSet};

use protocols::Instant;

use super::Failure;
use super::atlas::Atlas;
use super::config::NextView;
use super::drive::{Progress, Stretch};
use super::link::{Link, Sight, Tell};
use super::look::Look;
use crate::cell_map::Cell;
use crate::frontier::{View, next_view, open_edges, reach};
use crate::pose::Pose;

/// Cost of a view of an open edge that shows nothing, and of a drive towards it.
const VIEW_COSTS: u8 = 4;
const DRIVE_COSTS: u8 = 1;
/// Maximum cost of an open edge before it is given up: the lidar cannot see the area behind it.
const COSTS_MAX: u8 = 12;
/// Paths planned before the next view counts as unreachable.
const PLANS_MAX: usize = 50;
/// Maximum number of changes to another view during a drive.
const TURNS_MAX: u8 = 2;
/// Maximum number of failed drives in a row: after each, the program requests the robot's pose and
/// starts another one.
const FAILURES_MAX: u32 = 5;

/// Progress of the exploration.
#[derive(Clone, Debug)]
pub(super) struct Explore {
    phase: Phase,
    costs: BTreeMap<Cell, u8>,
    given_up: BTreeSet<Cell>,
    /// The current view, and the open edges visible from there.
    place: Option<Cell>,
    edges: BTreeSet<Cell>,
    /// Number of changes to another view while the current one still showed some.
    turns: u8,
    failures: u32,
    /// The distance that the robot has rolled is unknown.
    is_lost: bool,
}

#[derive(Clone, Debug)]
enum Phase {
    Look(Look),
    /// The program sends the robot its pose, then chooses the next view.
    Tell(Tell, Pose),
    Drive(Stretch),
}

impl Explore {
    pub(super) fn new(link: &Link) -> Self {
        Self {
            phase: Phase::Look(Look::new(link)),
            costs: BTreeMap::new(),
            given_up: BTreeSet::new(),
            place: None,
            edges: BTreeSet::new(),
            turns: 0,
            failures: 0,
            is_lost: false,
        }
    }

    /// Runs one step; returns whether the map is complete.
    pub(super) fn step(
        &mut self,
        now: Instant,
        link: &mut Link,
        atlas: &mut Atlas,
    ) -> Result<bool, Failure> {
        match &mut self.phase {
            Phase::Look(look) => match look.step(now, link, Some(&atlas.walls))? {
                Some(sight) => self.put(link, atlas, &sight),
                None => Ok(false),
            },
            Phase::Tell(tell, pose) => match tell.step(now, link)? {
                true => {
                    let pose = *pose;
                    self.go_on(atlas, pose)
                }
                false => Ok(false),
            },
            Phase::Drive(stretch) => {
                match stretch.drive.step(now, link) {
                    Ok(Progress::Driving) => return Ok(false),
                    Ok(Progress::Arrived) => {
                        let is_last = stretch.is_last;
                        self.spend(if is_last { VIEW_COSTS } else { DRIVE_COSTS });
                        if is_last {
                            (self.place, self.turns) = (None, 0);
                        }
                        self.failures = 0;
                    }
                    Ok(Progress::Interrupted) | Err(_) if self.failures < FAILURES_MAX => {
                        self.failures += 1;
                        self.is_lost = true;
                    }
                    Ok(Progress::Interrupted) => return Err(Failure::NoAnswer),
                    Err(failure) => return Err(failure),
                }
                self.phase = Phase::Look(Look::new(link));
                Ok(false)
            }
        }
    }

    fn put(&mut self, link: &Link, atlas: &mut Atlas, sight: &Sight) -> Result<bool, Failure> {
        let pose = match core::mem::take(&mut self.is_lost) {
            true => atlas.recovered(sight),
            false => atlas.corrected(sight),
        };
        atlas.add(pose, sight)?;
        if atlas.global.view().is_none() {
            return Err(Failure::NothingSeen);
        }
        if !sight.is_off(pose) {
            return self.go_on(atlas, sight.pose);
        }
        self.phase = Phase::Tell(Tell::new(link, pose), pose);
        Ok(false)
    }

    /// Chooses the next view and the path there; true if no view is left.
    fn go_on(&mut self, atlas: &mut Atlas, pose: Pose) -> Result<bool, Failure> {
        let map = atlas.global.clone();
        for _ in 0..PLANS_MAX {
            let place = match atlas.view {
                NextView::Frontier => self.choose(atlas, pose)?,
                NextView::Random => atlas.random_view(),
            };
            let Some(place) = place else {
                return Ok(true);
            };
            if let Some(mut way) = atlas.plan(&map, pose, map.centre_of(place)) {
                self.phase = Phase::Drive(atlas.stretch(pose, &mut way, None));
                return Ok(false);
            }
            if atlas.view == NextView::Random {
                break;
            }
            self.place = None;
            self.spend(VIEW_COSTS);
        }
        Err(Failure::NoWay)
    }

    fn choose(&mut self, atlas: &Atlas, pose: Pose) -> Result<Option<Cell>, Failure> {
        let map = &atlas.global;
        let start = map.cell_of(pose.position())?;
        // Walls entered from a wrong pose enclose the robot: such a map is not complete.
        let reach = reach(map, &map.eroded(), start);
        if reach.is_empty() {
            return Err(Failure::NoWay);
        }
        let open = open_edges(map, start, &self.given_up);
        let Some(View { place, edges }) = next_view(map, start, &open) else {
            return Ok(None);
        };
        // During a drive the best view changes, because walls seen obliquely appear and disappear:
        // a robot that always takes the best view drives to and fro.
        let goes_on = self.place.filter(|place| reach.contains_key(place));
        let is_worth = self.edges.intersection(&open).count() * 2 >= self.edges.len();
        if goes_on.is_some() && is_worth && self.edges.is_disjoint(&edges) {
            if self.turns == TURNS_MAX {
                return Ok(goes_on);
            }
            self.turns += 1;
        }
        (self.place, self.edges) = (Some(place), edges);
        Ok(Some(place))
    }

    /// Adds to the cost of the current open edges.
    fn spend(&mut self, more: u8) {
        for edge in &self.edges {
            let costs = self.costs.entry(*edge).or_default();
            *costs = costs.saturating_add(more);
            if *costs >= COSTS_MAX {
                self.given_up.insert(*edge);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::PcConfig;
    use super::*;
    use crate::grid::{FREE, OBSTACLE};

    /// A room of 70 by 9 cells, longer than a view, with a door of five cells at each end. From
    /// near its left end the left door is the better view. A robot that drives to the right one
    /// turns twice, and then continues while half of its goal is still open.
    #[test]
    fn who_is_on_the_way_goes_on() {
        let mut atlas = Atlas::new(&PcConfig::default());
        for (x, y) in (0..=71).flat_map(|x| (0..=10).map(move |y| (x, y))) {
            let is_door = [0, 71].contains(&x) && (3..8).contains(&y);
            let is_wall = [0, 71].contains(&x) || [0, 10].contains(&y);
            let value = if is_wall && !is_door { OBSTACLE } else { FREE };
            atlas.global.set(Cell::new(x, y), value).expect("fits");
        }
        let pose = Pose::new(450.0, 550.0, 0.0);
        let mut explore = Explore::new(&Link::new(&PcConfig::default()));
        let chosen = |explore: &mut Explore, atlas: &Atlas| {
            let place = explore.choose(atlas, pose).expect("not walled in");
            place.map(|place| place.x)
        };
        assert!(chosen(&mut explore, &atlas).is_some_and(|x| x < 8));
        let right = Cell::new(69, 5);
        let door = (3..7).map(|y| Cell::new(71, y));
        for turns in 0..TURNS_MAX {
            (explore.place, explore.edges) = (Some(right), door.clone().collect());
            assert_eq!(explore.turns, turns);
            assert!(chosen(&mut explore, &atlas).is_some_and(|x| x < 8));
        }
        (explore.place, explore.edges) = (Some(right), door.collect());
        assert_eq!(chosen(&mut explore, &atlas), Some(69));
        let mut close = |y| atlas.global.set(Cell::new(71, y), OBSTACLE);
        assert!(close(3).is_ok() && close(7).is_ok());
        // Three open cells are left: (71, 4) to (71, 6).
        assert_eq!(chosen(&mut explore, &atlas), Some(69));
        explore
            .given_up
            .extend([Cell::new(71, 4), Cell::new(71, 5)]);
        assert!(chosen(&mut explore, &atlas).is_some_and(|x| x < 8));
        // The robot does not go to a place without a path.
        explore.given_up.clear();
        let door = (4..7).map(|y| Cell::new(71, y));
        (explore.place, explore.edges) = (Some(Cell::new(80, 5)), door.collect());
        assert!(chosen(&mut explore, &atlas).is_some_and(|x| x < 8));
    }

    /// An edge is given up after three views of cost four, or twelve drives of cost one; an edge
    /// without a drive costs nothing.
    #[test]
    fn an_open_edge_that_costs_twelve_is_given_up() {
        let (one, other) = (Cell::new(3, 4), Cell::new(3, 5));
        let mut explore = Explore::new(&Link::new(&PcConfig::default()));
        explore.edges = [one].into();
        let costs = [4, 1, 1, 4, 1, 1].map(|more| {
            explore.spend(more);
            (explore.costs[&one], explore.given_up.contains(&one))
        });
        let told = [4, 5, 6, 10, 11, 12].map(|costs| (costs, costs == 12));
        assert_eq!(costs, told);
        explore.edges = [other].into();
        explore.spend(11);
        assert_eq!(explore.costs[&one], 12);
        assert!(!explore.given_up.contains(&other));
        explore.spend(250);
        assert_eq!(explore.costs[&other], 255);
        assert!(explore.given_up.contains(&other));
    }
}
