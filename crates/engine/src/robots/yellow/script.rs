//! Actions of the operator at the PC: the steps of the mission in the units of the program.

use core::time::Duration;

use firmware_core::robots::yellow::pc::PcCommand;

use crate::robots::script::Script;
use crate::robots::station::{PlaceAct, with_pose};
use crate::scenario::{Action, Mission, ScenarioError, SetPoint, Source, Step};

/// Name of the mode that drives by the IR sensors alone; a speed may follow, m/s.
const REACTIVE: &str = "reactive";
/// Nominal speed of the reactive drive without a speed behind the mode, m/s.
const REACTIVE_M_S: f32 = 0.3;
/// Speeds that the reactive drive accepts, m/s. The slider of the PC's window has steps of 0.1 m/s;
/// the limits are ours: a tenth of the usual speed moves the robot, and no wheel is faster than
/// [`WHEEL_MAX_M_S`].
const REACTIVE_LIMITS_M_S: [f32; 2] = [0.03, 1.8];
/// Track, metres.
const AXLE_M: f64 = 0.18;
/// Maximum speed of a wheel, m/s.
pub(super) const WHEEL_MAX_M_S: f64 = 1.8;
/// Delay between connecting and driving to a mission's waypoints.
const ORDER_AFTER: Duration = Duration::from_millis(200);
/// A mission that sets the pose within this time after its first order sends the pose first.
const EARLY: Duration = Duration::from_secs(1);

/// A wish of the operator.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Wish {
    /// Opens the connection to the robot.
    Connect,
    /// Closes the connection.
    Disconnect,
    /// A command of the program.
    Do(&'static str, PcCommand),
    /// Drives to all targets in order; builds a map first if there is none.
    Navigate,
    /// Sets other targets, metres.
    Targets(Vec<[f64; 2]>),
    /// Drives by hand: speeds of the wheels, m/s, and the resulting command.
    Drive(Vec<SetPoint>, PcCommand),
}

/// Modes that are single commands.
pub(super) const MODES: [(&str, PcCommand); 5] = [
    ("stop", PcCommand::Stop),
    (
        REACTIVE,
        PcCommand::Reactive {
            speed_m_s: REACTIVE_M_S,
        },
    ),
    ("map", PcCommand::MapStart),
    ("new-map", PcCommand::MapReset),
    ("localise", PcCommand::Localise),
];
/// Name of the mode that drives to the targets.
pub(super) const NAVIGATE: &str = "navigate";
/// Name of the mode that sets the believed pose; the pose follows.
const SET_POSE: &str = "set-pose";
/// Name of the mode that drives to a pose; the pose follows.
const GO_TO: &str = "go-to";
/// The actions of the program with a pose.
pub(super) const PLACE_ACTS: [PlaceAct; 2] = [
    PlaceAct {
        mode: SET_POSE,
        about: "Sets the robot's believed pose.",
        heading: true,
        is_goal: false,
    },
    PlaceAct {
        mode: GO_TO,
        about: "Drives the robot there and turns it.",
        heading: true,
        is_goal: true,
    },
];

impl Wish {
    /// The meaning of `action` for this robot.
    ///
    /// # Errors
    /// The expected action, if the robot does not support this mode or these axes.
    pub(super) fn of(action: &Action) -> Result<Self, String> {
        Ok(match action {
            Action::Connect => Self::Connect,
            Action::Disconnect => Self::Disconnect,
            Action::WaypointsM(targets) => Self::Targets(targets.clone()),
            Action::Mode(name) if name == NAVIGATE => Self::Navigate,
            Action::Mode(name) => {
                let found = MODES.iter().find(|(known, _)| known == name).copied();
                let (name, command) = match (found.or_else(|| of_a_pose(name)), speed_of(name)) {
                    (Some(found), _) => found,
                    (None, Some(speed)) => (REACTIVE, reactive(name, speed)?),
                    (None, None) => return Err(unknown_mode(name)),
                };
                Self::Do(name, command)
            }
            Action::Drive(set_points) => Self::Drive(set_points.clone(), by_hand(set_points)?),
            Action::Inject(_) | Action::Set(_) => {
                return Err(crate::robots::station::NOT_AN_ORDER.to_owned());
            }
        })
    }
}

/// Parses a mode with a pose, metres and degrees: `set-pose 0.5 1.2 90` sets the believed pose,
/// `go-to 0.5 1.2 90` drives to the pose.
fn of_a_pose(text: &str) -> Option<(&'static str, PcCommand)> {
    let (name, [x_m, y_m, degrees]) = with_pose(text)?;
    let heading_rad = degrees.to_radians();
    match name {
        SET_POSE => Some((
            SET_POSE,
            PcCommand::SetPose {
                x_m,
                y_m,
                heading_rad,
            },
        )),
        GO_TO => Some((
            GO_TO,
            PcCommand::Navigate {
                x_m,
                y_m,
                heading_rad: Some(heading_rad),
            },
        )),
        _ => None,
    }
}

/// The text behind [`REACTIVE`]: the speed of `reactive 0.2`.
fn speed_of(mode: &str) -> Option<&str> {
    let (name, speed) = mode.trim().split_once(char::is_whitespace)?;
    (name == REACTIVE).then(|| speed.trim())
}

/// The reactive drive at the speed of the text `speed`, m/s.
///
/// # Errors
/// If it is not a number within [`REACTIVE_LIMITS_M_S`]; the message has the whole `mode`.
fn reactive(mode: &str, speed: &str) -> Result<PcCommand, String> {
    let [least, most] = REACTIVE_LIMITS_M_S;
    let speed = speed.parse().ok();
    let speed_m_s = speed.filter(|speed| (least..=most).contains(speed));
    let speed_m_s = speed_m_s.ok_or_else(|| {
        format!("mode \"{mode}\": expected a speed behind {REACTIVE}, {least} to {most} m/s")
    })?;
    Ok(PcCommand::Reactive { speed_m_s })
}

fn unknown_mode(name: &str) -> String {
    let known = MODES.map(|(name, _)| name).join(", ");
    format!(
        "mode \"{name}\": expected one of {known}, {NAVIGATE}, {REACTIVE} with a speed in m/s, or \
         {SET_POSE} or {GO_TO} with metres along x and y and degrees"
    )
}

fn by_hand(set_points: &[SetPoint]) -> Result<PcCommand, String> {
    let &[SetPoint(left), SetPoint(right)] = set_points else {
        let count = set_points.len();
        return Err(format!(
            "drive has {count} set-points, expected left and right"
        ));
    };
    if [left, right]
        .iter()
        .any(|wheel| wheel.is_nan() || wheel.abs() > WHEEL_MAX_M_S)
    {
        return Err(format!(
            "drive [{left}, {right}]: expected speeds of the wheels, m/s, at most {WHEEL_MAX_M_S}"
        ));
    }
    #[expect(clippy::cast_possible_truncation, reason = "speeds fit an f32")]
    let [linear_m_s, angular_rad_s] =
        [f64::midpoint(left, right), (right - left) / AXLE_M].map(|value| value as f32);
    Ok(PcCommand::Manual {
        linear_m_s,
        angular_rad_s,
    })
}

/// The script of `mission`. Its waypoints are targets; the robot drives to them if no step orders a
/// mode.
///
/// # Errors
/// If the robot does not support a step.
pub(super) fn script(mission: &Mission, source: &Source) -> Result<Script<Wish>, ScenarioError> {
    let connect = mission.connect.instant();
    let mut first = vec![(connect, Wish::Connect)];
    let mut first_order = None;
    if !mission.waypoints_m.is_empty() {
        first.push((connect, Wish::Targets(mission.waypoints_m.clone())));
        // Setting the believed pose is not an order. A pose that is set before the tour is sent
        // first.
        let is_pose =
            |step: &&Step| matches!(&step.action, Action::Mode(name) if name.starts_with(SET_POSE));
        let is_order = |step: &Step| matches!(step.action, Action::Mode(_)) && !is_pose(&step);
        if !mission.step.iter().any(is_order) {
            let poses = mission.step.iter().filter(is_pose);
            let told = poses.filter_map(|step| Some(step.at?.instant())).min();
            let begins = connect + ORDER_AFTER;
            let early = told.filter(|&at| at <= begins + EARLY);
            first_order = Some(early.map_or(begins, |at| at.max(connect) + ORDER_AFTER));
        }
    }
    let mut script = Script::of(mission, source, first, Wish::of)?;
    if let Some(at) = first_order {
        script.put(at, Wish::Navigate);
    }
    Ok(script)
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
        let (x_m, y_m, heading_rad) = (0.5, -1.25, FRAC_PI_2);
        let set = PcCommand::SetPose {
            x_m,
            y_m,
            heading_rad,
        };
        let go = PcCommand::Navigate {
            x_m,
            y_m,
            heading_rad: Some(heading_rad),
        };
        assert_eq!(wish("set-pose 0.5 -1.25 90"), Ok(Wish::Do(SET_POSE, set)));
        assert_eq!(wish("go-to 0.5 -1.25 90"), Ok(Wish::Do(GO_TO, go)));
        for bad in [
            "go-to",
            "go-to 1 2",
            "go-to 1 2 3 4",
            "set-pose 1 2 nan",
            "map 1 2 3",
        ] {
            assert!(wish(bad).is_err(), "{bad}");
        }
    }

    /// The speed is that behind the mode, or 0.3 m/s; it has limits.
    #[test]
    fn the_reactive_drive_takes_a_speed() {
        for (name, speed_m_s) in [
            ("reactive", 0.3),
            ("reactive 0.2", 0.2),
            (" reactive  1.8 ", 1.8),
            ("reactive 0.03", 0.03),
        ] {
            let drive = PcCommand::Reactive { speed_m_s };
            assert_eq!(wish(name), Ok(Wish::Do(REACTIVE, drive)), "{name}");
        }
        for bad in ["0", "0.02", "1.9", "-0.2", "nan", "inf", "fast", "0.2 0.3"] {
            let said = wish(&format!("reactive {bad}")).expect_err(bad);
            let expected = format!(
                "mode \"reactive {bad}\": expected a speed behind reactive, 0.03 to 1.8 m/s"
            );
            assert_eq!(said, expected);
        }
        assert!(wish("reactively 0.2").is_err_and(|said| said.contains("reactive with a speed")));
    }

    /// A pose that is set at the start of the run does not prevent the tour.
    #[test]
    fn a_pose_told_before_the_tour_does_not_cancel_it() {
        let step = "[[step]]\nat = \"0s\"\ndo = { mode = \"set-pose 0.5 1.2 90\" }";
        let text = format!("waypoints_m = [[1.0, 1.0]]\n{step}\n");
        let mission: Mission = toml::from_str(&text).expect("a mission");
        let path = "t.toml".into();
        let mut script = script(&mission, &Source { path, text }).expect("known steps");
        let wishes = core::iter::from_fn(|| script.take(protocols::Instant::from_secs(60)));
        let wishes: Vec<Wish> = wishes.collect();
        assert!(matches!(wishes[2], Wish::Do(SET_POSE, _)), "{wishes:?}");
        assert_eq!(wishes[3..], [Wish::Navigate]);
    }
}
