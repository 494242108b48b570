//! Evaluation of conditions.

use super::Run;
use super::probe::Probe;
use crate::robots::Check;
use crate::robots::conditions::Moment;
use crate::scenario::{Condition, Flaw};

/// An observed condition, from its creation on.
#[derive(Clone, Debug)]
pub struct Watch(Probe);

impl Run {
    /// Starts to observe `condition`. Bytes, frames, contacts and log entries count from now on,
    /// without gaps. All other conditions are evaluated when [`has_come`](Self::has_come) is
    /// called.
    ///
    /// # Errors
    /// If a figure is invalid, or if the condition names an unknown item; the message lists the
    /// known ones.
    pub fn watch(&mut self, condition: &Condition) -> Result<Watch, Flaw> {
        condition.check()?;
        self.moment().check(condition)?;
        let lines = self.line_watches.clone().unwrap_or_default();
        let probe = Probe::new(condition, &self.moment(), &lines, true)?;
        if self.line_watches.is_none() && !lines.is_empty() {
            self.rig.add_tap(Box::new(lines.clone()));
            self.line_watches = Some(lines);
        }
        Ok(Watch(probe))
    }

    /// Whether the condition of `watch` has become true.
    pub fn has_come(&self, watch: &Watch) -> bool {
        watch.0.has_come(&self.moment(), &self.contacts) == Some(true)
    }

    /// Whether a condition on the current state is true.
    pub(super) fn holds_now(&self, condition: &Condition) -> bool {
        let reading = self.moment().reading(condition);
        reading.is_some_and(|reading| reading.holds == Some(true))
    }

    /// The current state of the run, for conditions.
    pub(super) fn moment(&self) -> Moment<'_> {
        Moment {
            rig: &self.rig,
            instruments: &*self.instruments,
            axes: None,
            devices: &self.scenario.device,
            waypoints: [self.progress.visits().len(), self.progress.waypoints()],
        }
    }

    /// A failed check for each condition of a fault that names a value which its device does not
    /// have: the condition cannot become true. The outputs of a program have names only while the
    /// program runs.
    pub(super) fn misnamed_faults(&self) -> impl Iterator<Item = Check> {
        let faults = self.scenario.fault.iter().enumerate();
        faults.flat_map(move |(number, fault)| {
            fault.conditions().filter_map(move |(key, condition)| {
                let missing = self.moment().missing(condition)?;
                let name = format!("fault-{number}-{}", key.replace('_', "-"));
                let detail = format!("{missing}: it cannot come true; expected {condition}");
                Some(Check::new(&name, false, detail))
            })
        })
    }

    /// Share of known cells of the robot's map, or of the map that its station received.
    pub fn known_share(&self) -> Option<f64> {
        self.moment().known_share()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use protocols::Instant;

    use super::*;
    use crate::robots::Axis;
    use crate::scenario::{
        AxisCondition, Figure, MapCondition, Op, Operand, RegisterCondition, Scenario,
    };

    /// Value of an unknown cell.
    const UNKNOWN: u8 = 127;

    /// Checks the share of known cells after eight seconds in a room: cells in the room are known,
    /// cells behind its walls are not.
    #[test]
    fn a_share_of_the_map_is_known() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/empty-room.toml");
        let (scenario, source) = Scenario::read(&path).expect("sound");
        let mut run = Run::new(scenario, &source, None).expect("can be wired");
        run.go_on_until(Instant::from_secs(8));
        let share = run.known_share().expect("it has a map");
        let map = run.instruments.map(&run.rig).expect("the same");
        let known = map.rows().flatten().filter(|cell| **cell != UNKNOWN);
        let (known, all) = (known.count(), map.width() * map.height());
        assert!(known > 100 && known < all, "{known} of {all}");
        assert!((share * all as f64 - known as f64).abs() < 1e-6, "{share}");
    }

    /// Checks that a condition distinguishes set-point and measured value of an axis. The two
    /// differ when the axis starts to move.
    #[test]
    fn an_axis_is_compared_by_the_figure_that_is_asked_for() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/yellow-reactive.toml");
        let (scenario, source) = Scenario::read(&path).expect("sound");
        let mut run = Run::new(scenario, &source, None).expect("can be wired");
        let axis = (1..1000).find_map(|step| {
            run.go_on_until(Instant::from_millis(10 * step));
            let axes = run.instruments.axes(&run.rig);
            let differ = |axis: &Axis| axis.actual.is_some_and(|actual| actual != axis.set_point);
            axes.into_iter().find(differ)
        });
        let axis = axis.expect("it drives");
        let actual = axis.actual.expect("it differs");
        let mut holds = |of, op, value| {
            let name = axis.name.to_string();
            let condition = Condition::Axis(AxisCondition {
                name,
                of,
                op,
                value,
            });
            let watch = run.watch(&condition).expect("there is such an axis");
            run.has_come(&watch)
        };
        let told = axis.set_point;
        assert!(holds(Figure::SetPoint, Op::Equal, told));
        assert!(holds(Figure::Actual, Op::Equal, actual));
        assert!(holds(Figure::Actual, Op::Unequal, told));
        assert!(!holds(Figure::SetPoint, Op::Equal, actual));
        assert!(!holds(Figure::SetPoint, Op::Unequal, told));
    }

    /// A condition cannot wait for an unknown item; the message lists the known names.
    #[test]
    fn only_what_there_is_can_be_waited_for() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/empty-room.toml");
        let (scenario, source) = Scenario::read(&path).expect("sound");
        let mut run = Run::new(scenario, &source, None).expect("can be wired");
        let axis = |name: &str| {
            Condition::Axis(AxisCondition {
                name: name.to_owned(),
                of: Figure::Actual,
                op: Op::Equal,
                value: 0.0,
            })
        };
        let register = |device: &str| {
            Condition::Register(RegisterCondition {
                device: device.to_owned(),
                address: Some(0),
                name: None,
                op: Op::Equal,
                value: Operand::Number(0.0),
            })
        };
        let axes = run.instruments.axes(&run.rig);
        let known = axes.first().expect("a robot that drives").name.to_string();
        assert!(run.watch(&axis(&known)).is_ok());
        let refused = run.watch(&axis("nose")).expect_err("no such axis").message;
        assert!(
            refused.contains("nose") && refused.contains(&known),
            "{refused:?}"
        );
        let refused = run.watch(&register("toaster")).expect_err("no such device");
        assert!(refused.message.contains("toaster"), "{refused:?}");
        let map = Condition::Map(MapCondition { known_min: 0.5 });
        assert!(run.known_share().is_some() && run.watch(&map).is_ok());
        let all = run.progress.waypoints();
        assert!(all == 0 || run.watch(&Condition::Visited(all)).is_ok());
        let refused = run
            .watch(&Condition::Visited(all + 1))
            .expect_err("too many");
        assert!(
            refused.message.contains(&format!("has {all} waypoints")),
            "{refused:?}"
        );
    }

    /// A condition on the state needs no watch of the lines.
    #[test]
    fn only_bytes_are_watched_on_the_lines() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/empty-room.toml");
        let (scenario, source) = Scenario::read(&path).expect("sound");
        let mut run = Run::new(scenario, &source, None).expect("can be wired");
        let map = Condition::Map(MapCondition { known_min: 0.5 });
        assert!(run.watch(&map).is_ok() && run.line_watches.is_none());
        assert!(run.checkpoint().is_some());
        let bytes = Condition::Bytes(crate::scenario::BytesCondition {
            link: "base".to_owned(),
            direction: crate::scenario::DirectionSpec::ToDevice,
            hex: None,
            count: Some(1),
        });
        let watch = run.watch(&bytes).expect("there is such a link");
        assert!(run.line_watches.is_some() && run.checkpoint().is_none());
        run.go_on_until(Instant::from_secs(1));
        assert!(run.has_come(&watch));
    }
}
