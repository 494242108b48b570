//! Steps of the mission that the rig itself executes: it puts bytes on lines and sets values.

use protocols::Instant;

use super::Run;
use crate::rig::Rig;
use crate::scenario::{Action, Flaw, InjectSpec, Mission, Scenario, SetSpec};

/// Future steps, the next one first.
#[derive(Clone, Debug, Default)]
pub(super) struct Deeds(Vec<Deed>);

/// A step: time, number in the mission from 1, action.
type Deed = (Instant, usize, Action);

impl Deeds {
    /// The steps of `mission` with a time.
    pub(super) fn of(mission: &Mission) -> Self {
        let steps = (1..).zip(&mission.step);
        let steps = steps.filter(|(_, step)| step.action.is_of_the_rig());
        let timed = steps
            .filter_map(|(number, step)| Some((step.at?.instant(), number, step.action.clone())));
        let mut deeds: Vec<Deed> = timed.collect();
        deeds.sort_by_key(|(at, ..)| *at);
        Self(deeds)
    }

    /// Adds a step after those with the same time.
    pub(super) fn add(&mut self, at: Instant, number: usize, action: Action) {
        let index = self.0.partition_point(|(other, ..)| *other <= at);
        self.0.insert(index, (at, number, action));
    }

    /// Time of the next step.
    pub(super) fn due(&self) -> Option<Instant> {
        self.0.first().map(|(at, ..)| *at)
    }
}

impl Run {
    /// Executes the steps that are due now. A step that cannot be executed is a failure of the
    /// mission.
    pub(super) fn do_deeds(&mut self) {
        let now = self.rig.now();
        while self.deeds.due().is_some_and(|at| at <= now) {
            let (_, number, action) = self.deeds.0.remove(0);
            let done = match &action {
                Action::Inject(inject) => put(&mut self.rig, inject),
                Action::Set(one) => set(&self.scenario, &mut self.rig, one),
                _ => Ok(()),
            };
            match (done, action) {
                (Err(flaw), _) => self.steps.fail_now(number, now, &flaw),
                (
                    Ok(()),
                    Action::Set(SetSpec {
                        device,
                        name,
                        value,
                    }),
                ) => {
                    self.note("value-set", format!("{device} {name} = {value}"));
                }
                (Ok(()), Action::Inject(InjectSpec { link, hex, .. })) => {
                    self.note("bytes-injected", format!("{hex} on {link}"));
                }
                (Ok(()), _) => {}
            }
        }
    }

    /// Whether the rig can execute a step. It is tried on a copy, so that a refused one changes
    /// nothing.
    pub(super) fn try_deed(&self, action: &Action) -> Result<(), Flaw> {
        self.moment().check_action(action)?;
        match action {
            Action::Inject(inject) => inject.bytes().map(drop),
            Action::Set(one) => {
                let copy = self.rig.fork();
                copy.map_or(Ok(()), |mut copy| set(&self.scenario, &mut copy, one))
            }
            _ => Ok(()),
        }
    }
}

/// Sets a value of a device.
fn set(scenario: &Scenario, rig: &mut Rig, one: &SetSpec) -> Result<(), Flaw> {
    let spec = scenario.device.get(&one.device);
    let spec = spec.ok_or_else(|| Flaw::new("device", "is no device of the scenario"))?;
    let done = spec.set(rig, &one.device, &one.name, &one.value);
    done.map_err(|message| Flaw::new("name", message))
}

/// Puts bytes on a line, at its rate.
fn put(rig: &mut Rig, inject: &InjectSpec) -> Result<(), Flaw> {
    let bytes = inject.bytes()?;
    let now = rig.now();
    let link = rig.links().iter().position(|link| link.name == inject.link);
    let link = link.ok_or_else(|| Flaw::new("link", "is no link of the robot"))?;
    let direction = crate::rig::line::Direction::from(inject.direction);
    let [sender, _] = rig.line_configs(rig.links()[link].line(direction));
    let lines = rig.lines_mut(link);
    let lines = lines.ok_or_else(|| Flaw::new("link", "has no lines"))?;
    let takes = sender.bytes_time(bytes.len() as u64);
    lines[direction as usize].play(now + takes, &bytes, 0);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::DirectionSpec;

    fn inject(hex: &str) -> Action {
        Action::Inject(InjectSpec {
            link: "sonar".to_owned(),
            direction: DirectionSpec::ToDevice,
            hex: hex.to_owned(),
        })
    }

    fn order(deeds: &Deeds) -> Vec<(u64, usize)> {
        let all = deeds.0.iter();
        all.map(|(at, number, _)| (at.as_millis(), *number))
            .collect()
    }

    const SONAR: &str = "schema = 1\nname = \"t\"\nrobot = \"none\"\nduration = \"9s\"\n\
                         device.sonar.text.baud = 9600\ndevice.sonar.text.command = []\n";

    fn run(steps: &str) -> Run {
        let text = format!("{SONAR}[mission]\nstep = [{steps}]\n");
        let (scenario, source) = Scenario::from_text(&text).expect("sound");
        Run::new(scenario, &source, None).expect("can be wired")
    }

    fn step(when: &str, hex: &str) -> String {
        format!(
            "{{ {when}, do = {{ inject = {{ link = \"sonar\", direction = \"to-device\", hex = \"{hex}\" }} }} }},"
        )
    }

    /// Steps with a time, by their times; one that is added later follows those of its time.
    #[test]
    fn steps_are_due_in_the_order_of_their_times() {
        let sent = "when = { bytes = { link = \"sonar\", direction = \"to-device\", count = 1 } }";
        let steps = step("at = \"3s\"", "01") + &step(sent, "02") + &step("at = \"1s\"", "03");
        let text = format!("{SONAR}[mission]\nstep = [{steps}]\n");
        let (scenario, _) = Scenario::from_text(&text).expect("sound");
        let mut deeds = Deeds::of(&scenario.mission);
        assert_eq!(order(&deeds), [(1_000, 3), (3_000, 1)]);
        for (millis, number) in [(3_000, 4), (2_000, 5), (500, 6), (3_000, 7)] {
            deeds.add(Instant::from_millis(millis), number, inject("04"));
        }
        let expected = [
            (500, 6),
            (1_000, 3),
            (2_000, 5),
            (3_000, 1),
            (3_000, 4),
            (3_000, 7),
        ];
        assert_eq!(order(&deeds), expected);
        assert_eq!(deeds.due(), Some(Instant::from_millis(500)));
        assert_eq!(Deeds::default().due(), None);
    }

    /// Two bytes of 10 bits at 9600 baud take 2.083 ms from 1 s on.
    #[test]
    fn bytes_are_put_on_the_line_at_its_rate() {
        let mut run = run(&step("at = \"1s\"", "5566"));
        let delivered = [999, 1_002, 1_003].map(|millis| {
            run.go_on_until(Instant::from_millis(millis));
            let line = run.rig.links()[0].line(crate::rig::line::Direction::ToDevice);
            line.traffic().delivered
        });
        assert_eq!(delivered, [0, 0, 2]);
        let notes = run.rig.events().iter().filter(|one| one.source == "rig");
        let notes: Vec<_> = notes
            .map(|one| (one.event.rule, &*one.event.detail, one.event.at.as_millis()))
            .collect();
        assert_eq!(notes, [("bytes-injected", "5566 on sonar", 1_000)]);
        let other = run.rig.links()[0].line(crate::rig::line::Direction::ToMaster);
        assert_eq!(other.traffic().delivered, 0);
    }

    /// A refused step has a reason, and leaves the run as it was.
    #[test]
    fn a_step_that_cannot_be_executed_is_refused() {
        let run = run("");
        assert_eq!(run.try_deed(&inject("55")), Ok(()));
        assert!(run.try_deed(&inject("5")).is_err());
        let set = Action::Set(SetSpec {
            device: "gone".to_owned(),
            name: "x".to_owned(),
            value: toml::from_str::<std::collections::BTreeMap<String, _>>("a = 1")
                .expect("a number")
                .remove("a")
                .expect("it is there"),
        });
        assert!(run.try_deed(&set).is_err());
        assert_eq!(run.try_deed(&Action::Connect), Ok(()));
        let Action::Set(one) = &set else { return };
        let mut copy = run.rig.fork().expect("plain");
        let flaw = super::set(&run.scenario, &mut copy, one).expect_err("no such device");
        assert_eq!(flaw.to_string(), "device: is no device of the scenario");
        let gone = InjectSpec {
            link: "gone".to_owned(),
            direction: DirectionSpec::ToDevice,
            hex: "55".to_owned(),
        };
        let flaw = put(&mut copy, &gone).expect_err("no such link");
        assert_eq!(flaw.to_string(), "link: is no link of the robot");
    }
}
