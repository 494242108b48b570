//! The phone's script: the mission's steps.

use protocols::car_board::{Level, Steering};

use crate::robots::script::Script;
use crate::robots::station::{PlaceAct, with_pose};
use crate::scenario::{Action, Mission, ScenarioError, SetPoint, Source, Step};

/// A wish of the operator.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Wish {
    /// Opens the app.
    Connect,
    /// Closes the app.
    Disconnect,
    /// Sets other goals, metres.
    Goals(Vec<[f64; 2]>),
    /// Selects a mode.
    Mode(Mode),
    /// Drives by hand: motor level and steering value.
    Drive([i8; 2]),
    /// Sets the believed pose: x, y, metres, and heading, radians.
    Pose([f32; 3]),
    /// Drives to this pose: x, y, metres, and heading, radians.
    GoTo([f32; 3]),
}

/// The car's mode, set by the toggles of the phone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    Remote,
    Autonomous,
    Gates,
    Mapping,
    Stop,
}

/// Modes by name.
pub(super) const MODES: [(&str, Mode); 5] = [
    ("stop", Mode::Stop),
    ("remote", Mode::Remote),
    ("autonomous", Mode::Autonomous),
    ("gates", Mode::Gates),
    ("mapping", Mode::Mapping),
];

/// Name of the mode that sets the believed pose; the pose follows.
const SET_POSE: &str = "set-pose";
/// Name of the mode that drives to a pose; the pose follows.
const GO_TO: &str = "go-to";
/// The operator's actions with a pose.
pub(super) const PLACE_ACTS: [PlaceAct; 2] = [
    PlaceAct {
        mode: SET_POSE,
        about: "Sets the car's believed pose.",
        heading: true,
        is_goal: false,
    },
    PlaceAct {
        mode: GO_TO,
        about: "Drives the car there, as its only goal.",
        heading: true,
        is_goal: true,
    },
];

impl Mode {
    /// The name of the mode.
    pub(super) fn name(self) -> &'static str {
        let found = MODES.iter().find(|(_, mode)| *mode == self);
        found.map_or("", |(name, _)| name)
    }
}

impl Wish {
    /// The meaning of `action` for this robot.
    ///
    /// # Errors
    /// The expected action, if the robot does not support this mode or these axes.
    pub(super) fn of(action: &Action) -> Result<Self, String> {
        Ok(match action {
            Action::Connect => Self::Connect,
            Action::Disconnect => Self::Disconnect,
            Action::WaypointsM(goals) => Self::Goals(goals.clone()),
            Action::Mode(name) => Self::of_mode(name)?,
            Action::Drive(set_points) => Self::Drive(by_hand(set_points)?),
            Action::Inject(_) | Action::Set(_) => {
                return Err(crate::robots::station::NOT_AN_ORDER.to_owned());
            }
        })
    }

    fn of_mode(name: &str) -> Result<Self, String> {
        if let Some((_, mode)) = MODES.iter().find(|(known, _)| *known == name) {
            return Ok(Self::Mode(*mode));
        }
        let pose =
            with_pose(name).map(|(name, [x, y, degrees])| (name, [x, y, degrees.to_radians()]));
        match pose {
            Some((SET_POSE, pose)) => Ok(Self::Pose(pose)),
            Some((GO_TO, pose)) => Ok(Self::GoTo(pose)),
            _ => {
                let known = MODES.map(|(name, _)| name).join(", ");
                Err(format!(
                    "mode \"{name}\": expected one of {known}, or {SET_POSE} or {GO_TO} with \
                     metres along x and y and degrees"
                ))
            }
        }
    }
}

fn by_hand(set_points: &[SetPoint]) -> Result<[i8; 2], String> {
    let whole = set_points
        .iter()
        .map(|one| i16::try_from(one.whole()?).ok());
    let whole: Option<Vec<i16>> = whole.collect();
    if let Some([level, value]) = whole.as_deref()
        && let (Ok(level), Ok(value)) = (Level::new(*level), Steering::new(*value))
    {
        return Ok([level.get(), value.get()]);
    }
    let shown: Vec<String> = set_points.iter().map(|one| one.0.to_string()).collect();
    let shown = shown.join(", ");
    Err(format!(
        "drive [{shown}]: expected a motor level from -10 to 10 and a steering value from -50 to 50"
    ))
}

/// The script of `mission`. Its waypoints are goals; the car drives to them if no step orders a
/// mode or drives by hand.
///
/// # Errors
/// If the robot does not support a step.
pub(super) fn script(mission: &Mission, source: &Source) -> Result<Script<Wish>, ScenarioError> {
    let connect = mission.connect.instant();
    let mut first = vec![(connect, Wish::Connect)];
    if !mission.waypoints_m.is_empty() {
        first.push((connect, Wish::Goals(mission.waypoints_m.clone())));
        // Setting the believed pose is not an order.
        let is_order = |step: &Step| match &step.action {
            Action::Mode(name) => !name.starts_with(SET_POSE),
            other => matches!(other, Action::Drive(_)),
        };
        if !mission.step.iter().any(is_order) {
            first.push((connect, Wish::Mode(Mode::Autonomous)));
        }
    }
    Script::of(mission, source, first, Wish::of)
}

#[cfg(test)]
mod tests {
    use core::f32::consts::FRAC_PI_2;

    use super::*;

    fn wish(name: &str) -> Result<Wish, String> {
        Wish::of(&Action::Mode(name.to_owned()))
    }

    #[test]
    fn a_pose_is_read_behind_its_mode() {
        let pose = [0.5, -1.25, FRAC_PI_2];
        assert_eq!(wish("set-pose 0.5 -1.25 90"), Ok(Wish::Pose(pose)));
        assert_eq!(wish("go-to 0.5 -1.25 90"), Ok(Wish::GoTo(pose)));
        assert_eq!(wish("gates"), Ok(Wish::Mode(Mode::Gates)));
        for bad in ["go-to", "go-to 1 2", "set-pose 1 2 inf", "gates 1 2 3"] {
            assert!(wish(bad).is_err(), "{bad}");
        }
    }

    /// After setting a pose the car still drives.
    #[test]
    fn a_pose_does_not_cancel_the_mission() {
        let step = "[[step]]\nat = \"0s\"\ndo = { mode = \"set-pose 0.5 1.2 90\" }";
        let text = format!("waypoints_m = [[1.0, 1.0]]\n{step}\n");
        let mission: Mission = toml::from_str(&text).expect("a mission");
        let path = "t.toml".into();
        let mut script = script(&mission, &Source { path, text }).expect("known steps");
        let wishes = core::iter::from_fn(|| script.take(protocols::Instant::from_secs(60)));
        let wishes: Vec<Wish> = wishes.collect();
        assert!(wishes.contains(&Wish::Mode(Mode::Autonomous)), "{wishes:?}");
        assert!(
            wishes.iter().any(|wish| matches!(wish, Wish::Pose(_))),
            "{wishes:?}"
        );
    }
}
