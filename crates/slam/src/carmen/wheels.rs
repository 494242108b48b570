//! The odometry in a log.

use emulators::world::Pose;

use super::{Laser, Message};
use crate::motion::{between, moved};

/// Maximum plausible distance between two messages, metres.
const STEP_MAX_M: f64 = 20.0;

/// The meaning of the poses in a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PoseKind {
    /// All poses are odometry.
    Wheels,
    /// Poses at scans are those of a mapper, poses between scans are odometry.
    Corrected,
}

impl PoseKind {
    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::Wheels => "poses are taken as wheel odometry",
            Self::Corrected => {
                "poses were corrected by a mapper: the wheel odometry is derived from the poses between the scans"
            }
        }
    }

    /// Detects a corrected log: behind each scan its odometry restarts at the pose of the scan,
    /// without a time of its own or after a jump at the same time.
    pub(super) fn of(messages: &[Message]) -> Self {
        let (mut corrected, mut plain) = (0_u32, 0_u32);
        for three in messages.windows(3) {
            let [
                Message::Odometry {
                    pose: before,
                    stamp: seen,
                },
                Message::Laser(laser),
                Message::Odometry { pose: after, stamp },
            ] = three
            else {
                continue;
            };
            let begins_anew = *after == laser.robot && *before != laser.robot;
            if begins_anew && (*stamp == 0.0 || *seen == laser.stamp) {
                corrected += 1;
            } else if before != after {
                plain += 1;
            }
        }
        if corrected > plain {
            Self::Corrected
        } else {
            Self::Wheels
        }
    }
}

/// The odometry, accumulated from messages.
pub(super) struct Chain {
    kind: PoseKind,
    last: Option<Pose>,
    since_shot: Pose,
    /// Whether odometry has arrived since the last scan.
    has_measured: bool,
}

impl Chain {
    pub(super) fn new(kind: PoseKind) -> Self {
        Self {
            kind,
            last: None,
            since_shot: Pose::default(),
            has_measured: false,
        }
    }

    pub(super) fn odometry(&mut self, pose: Pose) {
        self.advance(pose);
    }

    pub(super) fn scan(&mut self, laser: &Laser) {
        match self.kind {
            PoseKind::Wheels => self.advance(laser.robot),
            PoseKind::Corrected => self.last = Some(laser.robot),
        }
    }

    /// Restarts after an implausibly long step.
    fn advance(&mut self, pose: Pose) {
        if let Some(last) = self.last {
            let step = between(last, pose);
            if libm::hypot(step.x, step.y) < STEP_MAX_M {
                self.since_shot = moved(self.since_shot, step);
                self.has_measured = true;
            }
        }
        self.last = Some(pose);
    }

    /// The motion since the last call, and whether odometry measured it.
    pub(super) fn take(&mut self) -> (Pose, bool) {
        let has_measured = core::mem::take(&mut self.has_measured);
        (core::mem::take(&mut self.since_shot), has_measured)
    }
}
