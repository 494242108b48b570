//! The car's place on its map: localisation by guesses, and corrections of the pose.

use super::{Apollo13, CAMERA_AHEAD_M, Config};
use crate::ackermann::{CarPose, Motion};
use crate::particles::{LikelihoodField, Localiser, Noise, Settings as ParticleSettings};

/// Noise of the odometry: a fifth of its motion. With the seed's figures, ten times as much, the
/// guesses spread over the hall while the camera looks at a box that is on no map.
const NOISE: Noise = Noise {
    turn_by_turn: 0.04,
    turn_by_way: 0.04,
    way_by_way: 0.04,
    way_by_turn: 0.04,
};

/// Guesses around `start` on the car's map.
pub(super) fn localiser(config: &Config, start: CarPose) -> Localiser {
    let floor = &config.floor;
    let field = LikelihoodField::new(
        floor.width,
        floor.cell_m,
        floor.origin_m,
        &floor.obstacles,
        2.0,
    );
    let camera = CarPose::default().shifted(CAMERA_AHEAD_M);
    let sigma = [0.05, 0.05, 0.02];
    let settings = ParticleSettings {
        noise: NOISE,
        ..ParticleSettings::default()
    };
    Localiser::new(field, settings, camera, start, sigma, config.seed)
}

/// A correction beyond these counts as a jump, metres and radians: several times the odometry's
/// error between two scans.
const JUMP: [f64; 2] = [0.20, 0.20];

impl Apollo13 {
    /// Takes the car's pose from the operator, except while the car draws a map: then its own pose
    /// is better.
    pub fn set_pose(&mut self, pose: CarPose) {
        // A map under construction is drawn from the car's own pose.
        if self.survey.is_some() {
            return;
        }
        if let Some(localiser) = &mut self.localiser {
            localiser.place(pose, [0.3, 0.3, 0.17]);
        }
        self.misfits = 0;
        self.search.is_asked = true;
        self.jump_to(pose);
    }

    /// Takes the pose that a scan has found. After a jump, obstacles seen from the earlier pose lie
    /// elsewhere on the map.
    pub(super) fn correct(&mut self, pose: CarPose) {
        let off = self.pose().motion_to(pose);
        let is_far = libm::hypot(off.ahead_m, off.left_m) > JUMP[0];
        match is_far || off.turn_rad.abs() > JUMP[1] {
            true => self.jump_to(pose),
            false => self.move_origin(pose),
        }
    }

    /// Handles two motions that disagree about the turn. The passage of a gate ends: its posts are
    /// out of the camera's sight while the car is between them.
    pub(super) fn doubt_turn(&mut self, told: Motion, other: Motion) {
        if let Some(localiser) = &mut self.localiser {
            localiser.doubt(told, other);
        }
        if self.passage.take().is_some() {
            self.pilot.set_goal(None);
        }
    }

    /// Sets another pose. Markers near the car keep their position relative to it; obstacles seen
    /// from the wrong pose are discarded, and a path along them is planned again.
    fn jump_to(&mut self, pose: CarPose) {
        self.gates.carry(self.pose(), pose);
        self.floor.forget();
        self.floor
            .stand(self.gates.markers().map(|(_, place)| place));
        match self.passage.take() {
            Some(_) => self.pilot.set_goal(None),
            None => self.pilot.plan_anew(),
        }
        self.move_origin(pose);
    }

    /// Sets the odometry's origin such that the car is at `pose`.
    pub(super) fn move_origin(&mut self, pose: CarPose) {
        let back = self.odometry.pose().motion_to(CarPose::default());
        self.origin = pose.then(back);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robots::apollo13::floor::FloorPlan;
    use crate::robots::apollo13::gates::Passage;

    const HERE: CarPose = CarPose {
        x_m: 1.5,
        y_m: 2.0,
        heading_rad: 0.0,
    };

    /// The car at [`HERE`] on its way to a gate 1.9 m ahead, of which it has seen a post.
    fn passing() -> Apollo13 {
        let mut car = Apollo13::new(Config {
            floor: FloorPlan {
                width: 120,
                cell_m: 0.05,
                origin_m: [0.0; 2],
                obstacles: alloc::vec![false; 120 * 80],
            },
            start: HERE,
            ..Config::default()
        });
        for _ in 0..2 {
            car.gates.see(1, [2.5, 2.0]);
        }
        let passage = Passage {
            gate: [1, 2],
            before: HERE.shifted(1.0),
            middle: HERE.shifted(1.9),
            behind: HERE.shifted(2.5),
        };
        car.passage = Some(passage);
        car.pilot.set_goal(Some(passage.before));
        car
    }

    /// The car finds itself turned by 0.1 or 0.3 rad, or 0.3 m to the side. Far corrections keep
    /// the post 1 m ahead and end the passage, near ones leave both at their places of the map.
    #[test]
    fn a_jump_of_the_pose_takes_the_near_markers_along_and_ends_the_passage() {
        for (left_m, turn_rad, is_jump) in [(0.0, 0.1, false), (0.0, 0.3, true), (0.3, 0.0, true)] {
            let mut car = passing();
            let found = CarPose {
                y_m: 2.0 + left_m,
                heading_rad: turn_rad,
                ..HERE
            };
            car.correct(found);
            assert!(car.pose().distance_m(found) < 1e-9);
            assert_eq!(car.passage.is_none(), is_jump);
            assert_eq!(car.pilot.goal().is_none(), is_jump);
            let ahead = found.shifted(1.0);
            let post = if is_jump {
                [ahead.x_m, ahead.y_m]
            } else {
                [2.5, 2.0]
            };
            let (_, at) = car.gates.markers().next().unwrap();
            assert!((at[0] - post[0]).abs() < 1e-9 && (at[1] - post[1]).abs() < 1e-9);
        }
    }

    /// A drive to a goal continues.
    #[test]
    fn a_turn_in_doubt_ends_the_passage_of_a_gate() {
        let mut car = passing();
        car.doubt_turn(Motion::default(), Motion::default());
        assert!(car.passage.is_none() && car.pilot.goal().is_none());
        car.pilot.set_goal(Some(HERE));
        car.doubt_turn(Motion::default(), Motion::default());
        assert_eq!(car.pilot.goal(), Some(HERE));
    }
}
