//! Localisation of the robot on the map: look, compare; if positions look alike, drive on a little
//! and look again.

use alloc::collections::BTreeSet;

use protocols::Instant;

use super::Failure;
use super::atlas::Atlas;
use super::drive::{Progress, Stretch};
use super::link::{Link, Sight, Tell};
use super::look::Look;
use crate::frontier::{next_view, open_edges};
use crate::local_map::{Segment, local_map};
use crate::localise::{Estimate, Matches, Votes};
use crate::pose::Pose;
use crate::walls::Walls;

/// Maximum number of looks: positions that still look alike then cannot be distinguished.
const LOOKS_MAX: u32 = 8;
/// Ratio of scores from which a second pose may be the true one. Scores are of cells of 10 cm, and
/// the wrong one of two similar rooms has reached 0.89 to 1. The exact walls decide.
const CLOSE: f32 = 0.8;
/// Minimum share of the first pose's fit that the second one needs: a wall that was mapped skewed
/// may be missing.
const AS_MANY: f32 = 0.75;

/// The progress.
#[derive(Clone, Debug)]
pub(super) struct Find {
    phase: Phase,
    /// Matches so far, and the odometry's pose then.
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

    /// Runs one step; returns whether the robot knows its pose.
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
                    // The distance since the last look is unknown.
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
        // The course's programs accept any result.
        let is_doubtful =
            estimate.is_ambiguous() || has_rival(&estimate, &atlas.walls, &sight.lines);
        if atlas.votes != Votes::Best || !is_doubtful {
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

/// Whether the scan fits the walls at the second-best pose as well.
fn has_rival(estimate: &Estimate, walls: &Walls, lines: &[Segment]) -> bool {
    let share = |pose| walls.share_known(pose, lines);
    let is_close = estimate.ratio > CLOSE && !walls.is_empty();
    is_close && share(estimate.second) >= AS_MANY * share(estimate.pose)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Point;

    /// Two rooms of 1.6 m, 2.4 m apart; one or two of the second room's four walls were not mapped.
    #[test]
    fn what_fits_the_walls_of_another_room_is_not_certain() {
        let corners = [
            [-800.0, -800.0],
            [800.0, -800.0],
            [800.0, 800.0],
            [-800.0, 800.0],
        ];
        let lines = [0, 1, 2, 3].map(|at| {
            let [from, to] = [corners[at], corners[(at + 1) % 4]];
            Segment::new(Point::new(from[0], from[1]), Point::new(to[0], to[1]))
        });
        let [one, other] = [1_650.0, 4_050.0].map(|x_mm| Pose::new(x_mm, 1_850.0, 0.0));
        let is_doubtful = |ratio: f32, mapped: usize| {
            let estimate = Estimate {
                pose: one,
                score: 0.95,
                second: other,
                second_cells: 24.0,
                ratio,
            };
            let mut walls = Walls::default();
            walls.add(one, &lines);
            walls.add(other, &lines[..mapped]);
            has_rival(&estimate, &walls, &lines)
        };
        let of_four = [4, 3, 2, 0].map(|mapped| is_doubtful(0.89, mapped));
        assert_eq!(of_four, [true, true, false, false]);
        assert!(!is_doubtful(0.79, 4));
        // A map from a file has known cells, but no walls.
        let nothing = Estimate {
            pose: one,
            score: 0.95,
            second: other,
            second_cells: 24.0,
            ratio: 0.89,
        };
        assert!(!has_rival(&nothing, &Walls::default(), &lines));
    }
}
