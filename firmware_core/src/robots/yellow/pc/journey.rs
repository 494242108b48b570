//! A drive to a goal in stretches. Odometry drifts with the distance. After each stretch the robot
//! therefore looks around, and the program sends it the pose that the walls give. This is also done
//! at the goal, and the robot drives to the goal once more if it is beside it. Without a known path
//! the robot drives as near as it can. It enters its scan there into the map, because the blocking
//! obstacle may be an error of the map.

use alloc::collections::VecDeque;

use protocols::Instant;

use super::Failure;
use super::atlas::Atlas;
use super::drive::{Goal, Progress, Stretch};
use super::link::{Link, Tell};
use super::look::Look;
use crate::cell_map::Cell;
use crate::frontier::reach;
use crate::pose::{Point, Pose};

/// Accuracy of one drive: the robot's own 20 mm, and its rolling on.
const NEAR_MM: f32 = 30.0;
const NEAR_RAD: f32 = 0.04;
/// Maximum number of corrections beside the goal.
const AGAIN_MAX: u32 = 4;
/// Maximum number of drives that the robot ends early.
const INTERRUPTIONS_MAX: u32 = 5;
/// Maximum number of searches for a path where none is known.
const SEARCHES_MAX: u32 = 4;

/// A drive to a goal.
#[derive(Clone, Debug)]
pub(super) struct Journey {
    goal: Goal,
    /// Remaining points of the path, the goal's last.
    way: VecDeque<Point>,
    phase: Phase,
    again: u32,
    /// The path does not lead to the goal, but to a view that may show a path.
    searches: bool,
    searched: u32,
    interruptions: u32,
    /// The distance that the robot has rolled is unknown.
    is_lost: bool,
}

#[derive(Clone, Debug)]
enum Phase {
    /// Initial phase.
    Begin,
    Drive(Stretch),
    /// A look at the end of a stretch, which may be the last one.
    Look(Look, bool),
    Tell(Tell, Pose, bool),
}

impl Journey {
    pub(super) const fn new(goal: Goal) -> Self {
        Self {
            goal,
            way: VecDeque::new(),
            phase: Phase::Begin,
            again: 0,
            searches: false,
            searched: 0,
            interruptions: 0,
            is_lost: false,
        }
    }

    /// Runs one step; returns whether the robot has arrived.
    pub(super) fn step(
        &mut self,
        now: Instant,
        link: &mut Link,
        atlas: &mut Atlas,
    ) -> Result<bool, Failure> {
        match &mut self.phase {
            Phase::Begin => {
                let Some(pose) = link.heard().and_then(|heard| heard.pose()) else {
                    return Ok(false);
                };
                self.drive(atlas, pose)?;
                self.step(now, link, atlas)
            }
            Phase::Drive(stretch) => {
                let progress = stretch.drive.step(now, link)?;
                let is_last = stretch.is_last && progress == Progress::Arrived;
                match progress {
                    Progress::Driving => return Ok(false),
                    Progress::Arrived if is_last && !atlas.corrects() => return Ok(true),
                    Progress::Arrived => {}
                    Progress::Interrupted => self.interrupt()?,
                }
                self.phase = Phase::Look(Look::new(link), is_last);
                Ok(false)
            }
            Phase::Look(look, is_last) => {
                let Some(sight) = look.step(now, link, Some(&atlas.walls))? else {
                    return Ok(false);
                };
                let is_last = *is_last;
                let pose = match core::mem::take(&mut self.is_lost) {
                    true => atlas.recovered(&sight),
                    false => atlas.corrected(&sight),
                };
                if self.searches {
                    atlas.add(pose, &sight)?;
                }
                if !sight.is_off(pose) {
                    return self.go_on(atlas, sight.pose, is_last);
                }
                self.phase = Phase::Tell(Tell::new(link, pose), pose, is_last);
                Ok(false)
            }
            Phase::Tell(tell, pose, is_last) => match tell.step(now, link)? {
                true => {
                    let (pose, is_last) = (*pose, *is_last);
                    self.go_on(atlas, pose, is_last)
                }
                false => Ok(false),
            },
        }
    }

    /// Requests another path from the robot's current pose.
    fn interrupt(&mut self) -> Result<(), Failure> {
        self.interruptions += 1;
        if self.interruptions > INTERRUPTIONS_MAX {
            return Err(Failure::NoAnswer);
        }
        self.way.clear();
        self.is_lost = true;
        Ok(())
    }

    fn go_on(&mut self, atlas: &mut Atlas, pose: Pose, is_last: bool) -> Result<bool, Failure> {
        if is_last && !self.searches {
            if self.goal.is_near(pose, NEAR_MM, NEAR_RAD) {
                return Ok(true);
            }
            self.again += 1;
            if self.again > AGAIN_MAX {
                return Err(Failure::NoAnswer);
            }
        }
        self.drive(atlas, pose)?;
        Ok(false)
    }

    fn drive(&mut self, atlas: &mut Atlas, pose: Pose) -> Result<(), Failure> {
        if self.way.is_empty() {
            self.way = self.choose(atlas, pose)?;
        }
        let heading = self.goal.heading.filter(|_| !self.searches);
        let mut stretch = atlas.stretch(pose, &mut self.way, heading);
        if self.again > 0 {
            stretch.drive.nearer(NEAR_MM, NEAR_RAD);
        }
        self.phase = Phase::Drive(stretch);
        Ok(())
    }

    /// The path to the goal, or to a view that may show one.
    fn choose(&mut self, atlas: &mut Atlas, pose: Pose) -> Result<VecDeque<Point>, Failure> {
        let map = atlas.global.clone();
        let way = atlas.plan(&map, pose, self.goal.place);
        self.searches = way.is_none();
        if let Some(way) = way {
            return Ok(way);
        }
        self.searched += 1;
        if self.searched > SEARCHES_MAX || !atlas.corrects() {
            return Err(Failure::NoWay);
        }
        let (start, goal) = (map.cell_of(pose.position())?, map.cell_of(self.goal.place)?);
        let reach = reach(&map, &map.eroded(), start);
        let order =
            |one: &&Cell, other: &&Cell| one.distance(goal).total_cmp(&other.distance(goal));
        let nearest = reach.keys().min_by(order).ok_or(Failure::NoWay)?;
        let way = atlas.plan(&map, pose, map.centre_of(*nearest));
        way.ok_or(Failure::NoWay)
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::PcConfig;
    use super::*;
    use crate::grid::{FREE, UNKNOWN};
    use crate::local_map::{CELL_MM, Segment};
    use crate::map_view::MapView;

    const GOAL: Goal = Goal {
        place: Point::new(550.0, 550.0),
        heading: None,
    };

    /// Ten columns and twenty rows of free cells with unknown surroundings.
    fn known() -> Atlas {
        let cells = [[FREE; 10], [UNKNOWN; 10]].concat().repeat(20);
        let mut atlas = Atlas::new(&PcConfig::default());
        let map = MapView::new(20, CELL_MM, [0.0; 2], &cells);
        atlas.load(&map).expect("small");
        atlas
    }

    /// Five interruptions are accepted; each time the drive continues from the robot's pose.
    #[test]
    fn a_drive_that_is_interrupted_too_often_is_given_up() {
        let mut journey = Journey::new(GOAL);
        for _ in 0..5 {
            journey.way = [GOAL.place].into();
            journey.is_lost = false;
            assert_eq!(journey.interrupt(), Ok(()));
            assert!(journey.way.is_empty() && journey.is_lost);
        }
        assert_eq!(journey.interrupt(), Err(Failure::NoAnswer));
    }

    /// 30 mm from the goal the robot has not arrived yet, at 29 it has; it gets four more drives,
    /// and no fifth. The end of a stretch, or of a drive to a view, does not count.
    #[test]
    fn a_robot_beside_its_goal_tries_four_times_more() {
        let mut atlas = known();
        let beside = |off_mm: f32| Pose::new(550.0 + off_mm, 550.0, 0.0);
        let mut journey = Journey::new(GOAL);
        assert_eq!(journey.go_on(&mut atlas, beside(29.0), true), Ok(true));
        for _ in 0..6 {
            assert_eq!(journey.go_on(&mut atlas, beside(30.0), false), Ok(false));
        }
        journey.searches = true;
        journey.way = [GOAL.place].into();
        assert_eq!(journey.go_on(&mut atlas, beside(0.0), true), Ok(false));
        journey.searches = false;
        for _ in 0..4 {
            assert_eq!(journey.go_on(&mut atlas, beside(-30.0), true), Ok(false));
        }
        let fifth = journey.go_on(&mut atlas, beside(-30.0), true);
        assert_eq!(fifth, Err(Failure::NoAnswer));
        // A requested heading counts as well: 0.04 rad.
        let looking = Goal {
            heading: Some(0.04),
            ..GOAL
        };
        let mut journey = Journey::new(looking);
        assert_eq!(journey.go_on(&mut atlas, beside(0.0), true), Ok(false));
        let pose = Pose::new(550.0, 550.0, 0.01);
        assert_eq!(journey.go_on(&mut atlas, pose, true), Ok(true));
    }

    /// The goal is a metre beyond the known area. The robot starts on the left side and drives to
    /// the nearest reachable cell, eight columns on, four times. Without walls for a correction it
    /// does not search at all.
    #[test]
    fn a_way_is_looked_for_four_times_where_none_is_known() {
        let beyond = Goal::passed(Point::new(1_950.0, 1_050.0));
        let start = Pose::new(250.0, 1_050.0, 0.0);
        let mut atlas = known();
        let mut journey = Journey::new(beyond);
        let way = journey.choose(&mut atlas, start);
        assert_eq!(way, Err(Failure::NoWay));
        let wall = Segment::new(Point::new(-100.0, 0.0), Point::new(-100.0, 1_900.0));
        atlas.walls.add(Pose::default(), &[wall]);
        let mut journey = Journey::new(beyond);
        for _ in 0..4 {
            let way = journey
                .choose(&mut atlas, start)
                .expect("as near as it can");
            assert_eq!(way.back(), Some(&Point::new(850.0, 1_050.0)));
            assert!(journey.searches);
        }
        let fifth = journey.choose(&mut atlas, start);
        assert_eq!(fifth, Err(Failure::NoWay));
        // A drive on a known path is no search.
        let mut journey = Journey::new(GOAL);
        let way = journey.choose(&mut atlas, start).expect("it is free");
        assert_eq!(way.back(), Some(&GOAL.place));
        assert!(!journey.searches && journey.searched == 0);
    }
}
