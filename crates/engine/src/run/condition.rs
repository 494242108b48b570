//! Whether a condition has come true.

use super::Run;
use super::line_watch::{LineWatch, LineWatches, Wanted};
use crate::Shared;
use crate::codec::Stream;
use crate::rig::line::Direction;
use crate::scenario::{
    AxisCondition, Condition, DirectionSpec, EventCondition, Figure, Flaw, PoseCondition,
    RegisterCondition,
};

/// A cell of a map that was never seen.
const UNKNOWN: u8 = 127;

/// A condition under watch, from when it was made.
#[derive(Clone)]
pub struct Watch {
    condition: Condition,
    /// Entries of the log that were there before.
    events: usize,
    line: Option<Shared<LineWatch>>,
}

impl core::fmt::Debug for Watch {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("Watch").field(&self.condition).finish()
    }
}

impl Run {
    /// Starts to watch `condition`. Bytes, frames and log entries count from now on, without gaps;
    /// everything else is evaluated when [`has_come`](Self::has_come) is called.
    ///
    /// # Errors
    /// If its figures make no sense, or if it names an unknown item; the message lists the known
    /// ones.
    pub fn watch(&mut self, condition: &Condition) -> Result<Watch, Flaw> {
        condition.check()?;
        let line = match condition {
            Condition::Bytes(bytes) => {
                let wanted = match (bytes.pattern()?, bytes.count) {
                    (Some(pattern), _) => Wanted::Pattern {
                        pattern,
                        tail: Vec::new(),
                    },
                    (None, count) => Wanted::Count(count.unwrap_or(1)),
                };
                Some(self.watch_line(&bytes.link, bytes.direction, wanted)?)
            }
            Condition::Frame(frame) => {
                let link = self.link_index(&frame.link)?;
                let name = &self.rig.links()[link].name;
                let direction = Direction::from(frame.direction);
                let codec = self.instruments.codec_towards(&self.rig, name, direction);
                let codec = codec.ok_or_else(|| {
                    let message = format!("what {name} speaks is not known: expected `bytes`");
                    Flaw::new("link", message)
                })?;
                let wanted = Wanted::Frame {
                    contains: frame.contains.clone(),
                    codec,
                    stream: Stream::towards(codec, direction),
                    heard: self.rig.now(),
                };
                Some(self.watch_line(&frame.link, frame.direction, wanted)?)
            }
            other => {
                self.has_what_is_named(other)?;
                None
            }
        };
        Ok(Watch {
            condition: condition.clone(),
            events: self.rig.events().len(),
            line,
        })
    }

    fn watch_line(
        &mut self,
        link: &str,
        direction: DirectionSpec,
        wanted: Wanted,
    ) -> Result<Shared<LineWatch>, Flaw> {
        let link = self.link_index(link)?;
        let rig = &mut self.rig;
        let watches = self.line_watches.get_or_insert_with(|| {
            let watches = LineWatches::default();
            rig.add_tap(Box::new(watches.clone()));
            watches
        });
        Ok(watches.add(LineWatch {
            link,
            direction: Direction::from(direction),
            wanted,
            is_found: false,
        }))
    }

    fn link_index(&self, name: &str) -> Result<usize, Flaw> {
        let links = self.rig.links();
        let index = links.iter().position(|link| link.name == name);
        index.ok_or_else(|| {
            let all: Vec<&str> = links.iter().map(|link| link.name.as_str()).collect();
            let message = format!("is {name:?}, expected one of {}", all.join(", "));
            Flaw::new("link", message)
        })
    }

    /// Checks that the run has the objects of `condition`.
    fn has_what_is_named(&self, condition: &Condition) -> Result<(), Flaw> {
        match condition {
            Condition::Register(register) => {
                let RegisterCondition {
                    device, address, ..
                } = register;
                let value = self.rig.register(device, *address);
                value.map(drop).ok_or_else(|| {
                    let message = format!("there is no device {device:?} with register {address}");
                    Flaw::new("device", message)
                })
            }
            Condition::Axis(axis) => {
                let axes = self.instruments.axes(&self.rig);
                if axes.iter().any(|one| one.name == axis.name) {
                    return Ok(());
                }
                let all: Vec<&str> = axes.iter().map(|axis| &*axis.name).collect();
                let all = match all.is_empty() {
                    true => "but the robot has no axes".to_owned(),
                    false => format!("expected one of {}", all.join(", ")),
                };
                Err(Flaw::new("name", format!("is {:?}, {all}", axis.name)))
            }
            Condition::Visited(count) if *count > self.progress.waypoints() => {
                let all = self.progress.waypoints();
                let message = format!("is {count}, but the mission has {all} waypoints to count");
                Err(Flaw::new("visited", message))
            }
            Condition::Map(_) if self.known_share().is_none() && !self.may_get_a_map() => {
                let message = "the robot has no map that can be looked at from outside";
                Err(Flaw::new("map", message))
            }
            _ => Ok(()),
        }
    }

    /// Whether the condition of `watch` has become true.
    pub fn has_come(&self, watch: &Watch) -> bool {
        match (&watch.condition, &watch.line) {
            (_, Some(line)) => line.lock().is_found,
            (Condition::Event(EventCondition { rule, source }), _) => {
                let events = self.rig.events().get(watch.events..).unwrap_or_default();
                events.iter().any(|logged| {
                    let is_source = |source: &String| *source == logged.source;
                    logged.event.rule == rule && source.as_ref().is_none_or(is_source)
                })
            }
            (condition, None) => self.holds_now(condition),
        }
    }

    /// Whether a condition on the current state is true.
    pub(super) fn holds_now(&self, condition: &Condition) -> bool {
        match condition {
            Condition::Register(register) => {
                let value = self.rig.register(&register.device, register.address);
                value.is_some_and(|value| register.op.holds(&value, &register.value))
            }
            Condition::Pose(PoseCondition { near_m, within_m }) => {
                let pose = self.rig.world.pose();
                libm::hypot(pose.x - near_m[0], pose.y - near_m[1]) <= *within_m
            }
            Condition::Map(map) => self
                .known_share()
                .is_some_and(|share| share >= map.known_min),
            Condition::Visited(count) => self.progress.visits().len() >= *count,
            Condition::Axis(axis) => self.axis_holds(axis),
            Condition::Bytes(_) | Condition::Frame(_) | Condition::Event(_) => false,
        }
    }

    fn axis_holds(&self, wanted: &AxisCondition) -> bool {
        let axes = self.instruments.axes(&self.rig);
        let axis = axes.iter().find(|axis| axis.name == wanted.name);
        let value = axis.and_then(|axis| match wanted.of {
            Figure::SetPoint => Some(axis.set_point),
            Figure::Actual => axis.actual,
        });
        value.is_some_and(|value| wanted.op.holds(&value, &wanted.value))
    }

    /// Whether a map may come that is not there yet: the station receives one.
    fn may_get_a_map(&self) -> bool {
        let station = self.instruments.station(&self.rig);
        station.is_some_and(|station| station.has_whole_map().is_some())
    }

    /// Share of known cells of the robot's map, or of the one that its station received.
    pub fn known_share(&self) -> Option<f64> {
        let station = || self.instruments.station(&self.rig)?.map();
        let map = self.instruments.map(&self.rig).or_else(station)?;
        let cells = map.cells();
        let known = cells.iter().filter(|&&cell| cell != UNKNOWN).count();
        Some(known as f64 / cells.len().max(1) as f64)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use protocols::Instant;

    use super::*;
    use crate::robots::Axis;
    use crate::scenario::{MapCondition, Op, Scenario};

    /// Cells that were seen, of all: some after eight seconds in a room, and not those behind it.
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

    /// What an axis is told to do and what it does are two figures, which differ when it begins to
    /// drive.
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

    /// What is not there cannot be waited for; the message lists the known names.
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
                address: 0,
                op: Op::Equal,
                value: 0,
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
}
