//! Finding the robot on the map: look, compare; if places look alike, go on a little and look
//! again.

use alloc::collections::BTreeSet;

use protocols::Instant;

use super::Failure;
use super::atlas::Atlas;
use super::drive::{Progress, Stretch};
use super::link::{Link, Sight, Tell};
use super::look::Look;
use crate::frontier::{next_view, open_edges};
use crate::local_map::local_map;
use crate::localise::{Matches, Votes};
use crate::pose::Pose;

/// Most looks: places that still look alike then are alike.
const LOOKS_MAX: u32 = 8;

/// How far it is.
#[derive(Clone, Debug)]
pub(super) struct Find {
    phase: Phase,
    /// What fits so far, and where the odometry was then.
    known: Option<(Pose, Matches)>,
    looks: u32,
}

#[derive(Clone, Debug)]
enum Phase {
    Look(Look),
    Drive(Stretch),
    Tell(Tell),
}

impl Find {
    pub(super) fn new(link: &Link) -> Self {
        Self {
            phase: Phase::Look(Look::new(link)),
            known: None,
            looks: 0,
        }
    }

    /// Whether the robot knows where it is.
    pub(super) fn step(
        &mut self,
        now: Instant,
        link: &mut Link,
        atlas: &mut Atlas,
    ) -> Result<bool, Failure> {
        match &mut self.phase {
            Phase::Look(look) => {
                if let Some(sight) = look.step(now, link, None)? {
                    self.compare(link, atlas, &sight)?;
                }
                Ok(false)
            }
            Phase::Drive(stretch) => {
                match stretch.drive.step(now, link)? {
                    Progress::Driving => return Ok(false),
                    Progress::Arrived => {}
                    // Nobody knows how far it is from where it looked before.
                    Progress::Interrupted => self.known = None,
                }
                self.phase = Phase::Look(Look::new(link));
                Ok(false)
            }
            Phase::Tell(tell) => tell.step(now, link),
        }
    }

    fn compare(&mut self, link: &Link, atlas: &mut Atlas, sight: &Sight) -> Result<(), Failure> {
        self.looks += 1;
        let local = local_map(sight.pose, &sight.lines)?;
        let seen = Matches::new(&atlas.global, &sight.lines).ok_or(Failure::NothingSeen)?;
        let matches = match self.known.take() {
            Some((before, known)) => known.then(before.change_to(sight.pose), &seen),
            None => seen,
        };
        let estimate = matches.estimate(atlas.votes).ok_or(Failure::NothingSeen)?;
        atlas.estimate = Some(estimate);
        // The course's programs take what they get.
        if atlas.votes != Votes::Best || !estimate.is_ambiguous() {
            let pose = atlas.walls.corrected(estimate.pose, &sight.lines);
            self.phase = Phase::Tell(Tell::new(link, pose));
            atlas.local = Some(local_map(pose, &sight.lines)?);
            return Ok(());
        }
        atlas.ambiguous += 1;
        let start = local.cell_of(sight.pose.position())?;
        let edges = open_edges(&local, start, &BTreeSet::new());
        let view = next_view(&local, start, &edges).filter(|_| self.looks < LOOKS_MAX);
        let place = local.centre_of(view.ok_or(Failure::Ambiguous)?.place);
        let way = atlas.plan(&local, sight.pose, place);
        let mut way = way.ok_or(Failure::Ambiguous)?;
        self.phase = Phase::Drive(atlas.stretch(sight.pose, &mut way, None));
        self.known = Some((sight.pose, matches));
        atlas.local = Some(local);
        Ok(())
    }
}
