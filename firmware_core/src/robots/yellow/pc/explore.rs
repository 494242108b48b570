//! Making the map: look, put it on the map, choose where to look next, drive there, until nothing
//! is left.

use alloc::collections::{BTreeMap, BTreeSet};

use protocols::Instant;

use super::Failure;
use super::atlas::Atlas;
use super::config::NextView;
use super::drive::{Drive, Goal};
use super::link::{Link, Sight, Tell};
use super::look::Look;
use crate::cell_map::Cell;
use crate::frontier::{next_view, open_edges};
use crate::pose::{Pose, normalised};

/// Views of an open edge before it is given up: the lidar cannot see what is behind.
const TRIES_MAX: u8 = 3;
/// Ways that are looked for before the next view counts as unreachable.
const PLANS_MAX: usize = 50;
/// Smaller corrections are not worth a message.
const CORRECTION_MM: f32 = 5.0;
const CORRECTION_RAD: f32 = 0.005;

/// How far the mapping is.
#[derive(Clone, Debug)]
pub(super) struct Explore {
    phase: Phase,
    tries: BTreeMap<Cell, u8>,
    given_up: BTreeSet<Cell>,
}

#[derive(Clone, Debug)]
enum Phase {
    Look(Look),
    /// The robot is told where it is, then the next view is chosen.
    Tell(Tell, Pose),
    Drive(Drive),
}

impl Explore {
    pub(super) fn new(link: &Link) -> Self {
        Self {
            phase: Phase::Look(Look::new(link)),
            tries: BTreeMap::new(),
            given_up: BTreeSet::new(),
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
            Phase::Look(look) => match look.step(now, link)? {
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
            Phase::Drive(drive) => {
                if drive.step(now, link)? {
                    self.phase = Phase::Look(Look::new(link));
                }
                Ok(false)
            }
        }
    }

    fn put(&mut self, link: &Link, atlas: &mut Atlas, sight: &Sight) -> Result<bool, Failure> {
        let pose = atlas.corrected(sight);
        atlas.add(pose, sight)?;
        let shift = pose.position().distance_mm(sight.pose.position());
        let turn = normalised(pose.heading - sight.pose.heading).abs();
        if shift < CORRECTION_MM && turn < CORRECTION_RAD {
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
            let goal = Goal {
                place: map.centre_of(place),
                heading: None,
            };
            if let Some(drive) = atlas.drive(&map, pose, goal) {
                self.phase = Phase::Drive(drive);
                return Ok(false);
            }
            if atlas.view == NextView::Random {
                break;
            }
        }
        Err(Failure::NoWay)
    }

    fn choose(&mut self, atlas: &Atlas, pose: Pose) -> Result<Option<Cell>, Failure> {
        let map = &atlas.global;
        let start = map.cell_of(pose.position())?;
        let edges = open_edges(map, start, &self.given_up);
        let Some(view) = next_view(map, start, &edges) else {
            return Ok(None);
        };
        for edge in &view.edges {
            let tries = self.tries.entry(*edge).or_default();
            *tries += 1;
            if *tries == TRIES_MAX {
                self.given_up.insert(*edge);
            }
        }
        Ok(Some(view.place))
    }
}
