//! Making the map: look, put it on the map, choose where to look next, drive a stretch of the way
//! there, until nothing is left.

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

/// What a view of an open edge costs that shows nothing, and a drive towards it.
const VIEW_COSTS: u8 = 4;
const DRIVE_COSTS: u8 = 1;
/// What may be spent on an open edge before it is given up: the lidar cannot see what is behind.
const COSTS_MAX: u8 = 12;
/// Ways that are looked for before the next view counts as unreachable.
const PLANS_MAX: usize = 50;
/// Drives in sequence that may fail: the robot is asked where it is, and another one begins.
const FAILURES_MAX: u32 = 5;

/// How far the mapping is.
#[derive(Clone, Debug)]
pub(super) struct Explore {
    phase: Phase,
    costs: BTreeMap<Cell, u8>,
    given_up: BTreeSet<Cell>,
    /// The open edges that are driven to.
    edges: BTreeSet<Cell>,
    failures: u32,
    /// The robot does not know how far it has rolled.
    is_lost: bool,
}

#[derive(Clone, Debug)]
enum Phase {
    Look(Look),
    /// The robot is told where it is, then the next view is chosen.
    Tell(Tell, Pose),
    Drive(Stretch),
}

impl Explore {
    pub(super) fn new(link: &Link) -> Self {
        Self {
            phase: Phase::Look(Look::new(link)),
            costs: BTreeMap::new(),
            given_up: BTreeSet::new(),
            edges: BTreeSet::new(),
            failures: 0,
            is_lost: false,
        }
    }

    /// Whether the map is complete.
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

    /// Chooses the next view and the way there; true if there is nothing more to see.
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
            self.spend(VIEW_COSTS);
        }
        Err(Failure::NoWay)
    }

    fn choose(&mut self, atlas: &Atlas, pose: Pose) -> Result<Option<Cell>, Failure> {
        let map = &atlas.global;
        let start = map.cell_of(pose.position())?;
        // Walled in by what was seen from a pose that was none: such a map is not complete.
        if reach(map, &map.eroded(), start).is_empty() {
            return Err(Failure::NoWay);
        }
        let edges = open_edges(map, start, &self.given_up);
        let Some(View { place, edges }) = next_view(map, start, &edges) else {
            return Ok(None);
        };
        self.edges = edges;
        Ok(Some(place))
    }

    /// The open edges that are driven to have cost so much more.
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

    /// Three views of four, or twelve drives of one, and it is given up; what was never driven to
    /// costs nothing.
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
