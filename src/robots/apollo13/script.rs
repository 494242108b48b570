//! What whoever holds the phone does: the mission's steps.

use protocols::Instant;
use protocols::car_board::{Level, Steering};

use crate::scenario::{Action, Mission, ScenarioError, SetPoint, Source, Step};

/// What the phone's person asks for.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Wish {
    /// Opens the app.
    Connect,
    /// Closes it.
    Disconnect,
    /// Other goals, metres.
    Goals(Vec<[f64; 2]>),
    /// A mode.
    Mode(Mode),
    /// By hand: motor level and steering value.
    Drive([i8; 2]),
}

/// What the phone's toggles make of the car.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    Remote,
    Autonomous,
    Gates,
    Stop,
}

/// Modes by name.
pub(super) const MODES: [(&str, Mode); 4] = [
    ("stop", Mode::Stop),
    ("remote", Mode::Remote),
    ("autonomous", Mode::Autonomous),
    ("gates", Mode::Gates),
];

impl Mode {
    /// Its name.
    pub(super) fn name(self) -> &'static str {
        let found = MODES.iter().find(|(_, mode)| *mode == self);
        found.map_or("", |(name, _)| name)
    }
}

impl Wish {
    /// What `action` means here.
    ///
    /// # Errors
    /// What was expected, if the robot has no such mode or axes.
    pub(super) fn of(action: &Action) -> Result<Self, String> {
        Ok(match action {
            Action::Connect => Self::Connect,
            Action::Disconnect => Self::Disconnect,
            Action::WaypointsM(goals) => Self::Goals(goals.clone()),
            Action::Mode(name) => {
                let found = MODES.iter().find(|(known, _)| known == name);
                let (_, mode) = found.ok_or_else(|| {
                    let known = MODES.map(|(name, _)| name).join(", ");
                    format!("mode \"{name}\": expected one of {known}")
                })?;
                Self::Mode(*mode)
            }
            Action::Drive(set_points) => Self::Drive(by_hand(set_points)?),
        })
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

/// Wishes in the order of their times.
#[derive(Clone, Debug, Default)]
pub(super) struct Script {
    steps: Vec<(Instant, Wish)>,
    next: usize,
}

impl Script {
    /// The script of `mission`. Its waypoints are goals; if no step orders a mode or drives, they
    /// are driven to.
    ///
    /// # Errors
    /// If a step is none for this robot.
    pub(super) fn of(mission: &Mission, source: &Source) -> Result<Self, ScenarioError> {
        for (index, step) in mission.step.iter().enumerate() {
            Wish::of(&step.action).map_err(|message| {
                let span = source.find_in_list("mission.step", index, "do");
                source.invalid(span, format!("mission.step[{index}].do"), message)
            })?;
        }
        let connect = mission.connect.instant();
        let mut steps = vec![(connect, Wish::Connect)];
        if !mission.waypoints_m.is_empty() {
            steps.push((connect, Wish::Goals(mission.waypoints_m.clone())));
            let is_order = |step: &Step| matches!(step.action, Action::Mode(_) | Action::Drive(_));
            if !mission.step.iter().any(is_order) {
                steps.push((connect, Wish::Mode(Mode::Autonomous)));
            }
        }
        // Steps with a condition are handed over when it has come true.
        let mut timed: Vec<&Step> = mission.step.iter().filter(|it| it.at.is_some()).collect();
        timed.sort_by_key(|step| step.at);
        for step in timed {
            if let Ok(wish) = Wish::of(&step.action) {
                steps.push((step.at.unwrap_or_default().instant(), wish));
            }
        }
        Ok(Self { steps, next: 0 })
    }

    /// Number of its steps.
    pub(super) const fn len(&self) -> usize {
        self.steps.len()
    }

    /// Puts a step before the step `index`, but behind what was done.
    pub(super) fn insert(&mut self, index: usize, at: Instant, wish: Wish) {
        let index = index.clamp(self.next, self.steps.len());
        self.steps.insert(index, (at, wish));
    }

    /// When the next step is due.
    pub(super) fn due(&self) -> Option<Instant> {
        // A step does not overtake the one before it.
        self.steps.get(self.next).map(|(at, _)| *at)
    }

    /// The next step that is due by `now`.
    pub(super) fn take(&mut self, now: Instant) -> Option<Wish> {
        let (at, wish) = self.steps.get(self.next)?;
        if *at > now {
            return None;
        }
        self.next += 1;
        Some(wish.clone())
    }
}
