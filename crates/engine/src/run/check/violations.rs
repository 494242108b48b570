//! Rules of devices that the program broke.

use protocols::Instant;

use super::safety::EFFECTS;
use super::{Check, Checker, Look, VIOLATIONS};
use crate::rig::Rig;
use crate::rig::fault::Window;
use crate::scenario::{Action, FaultKind, FaultSpec, Scenario};

/// Whether at most `max` rules were broken in the whole run.
pub(crate) fn violations(max: u64, rig: &Rig) -> Check {
    let found = rig.violations();
    let mut detail = format!("{found} broken rules, at most {max}");
    let mut events = rig.events().iter();
    if let Some(first) = events.find(|logged| logged.is_violation()) {
        detail += &format!("; first: {first}");
    }
    let is_asked = rig.was_asked();
    if !is_asked && found == 0 {
        "no device received a byte".clone_into(&mut detail);
    }
    Check::new(VIOLATIONS, found <= max, detail).if_observed(is_asked)
}

/// The program broke at most a given number of rules after the faults of a run.
#[derive(Clone, Debug)]
pub struct ViolationsLater {
    max: u64,
    from: Instant,
    /// Links with faults to the end, and the devices at their ends.
    exempt: Vec<String>,
    ends: Option<Vec<String>>,
    /// Links of the station, and the time of the last step that connects it.
    station: &'static [&'static str],
    connected: Option<Instant>,
    /// Whether the station disconnects: bytes for it then find its port closed.
    disconnects: bool,
    /// Whether the station gives an order after the time from which violations count; otherwise an
    /// order that is not confirmed was given during the faults.
    has_late_order: bool,
    /// Devices of the station that wait for answers over a connection that a fault has ended.
    unconnected: Vec<&'static str>,
    /// Start of each fault that has an end, and the end of its effects: violations in between do
    /// not count. A fault that waits for a condition may begin at any time.
    faults: Vec<[Instant; 2]>,
    /// The violations when the current time of counting began, and now.
    tallies: Option<[Tally; 2]>,
    /// The violations of earlier times of counting.
    found: Tally,
    is_observed: bool,
    /// Whether the time from which violations count has come.
    has_come: bool,
}

/// Violations up to a moment, or between two.
#[derive(Clone, Debug, Default)]
struct Tally {
    total: u64,
    /// Device, rule and number.
    rules: Vec<(String, &'static str, u64)>,
}

impl Tally {
    fn of(rig: &Rig) -> Self {
        Self {
            total: rig.violations(),
            rules: rig.all_broken_rules(),
        }
    }

    fn count(&self, device: &str, rule: &str) -> u64 {
        let mut rules = self.rules.iter();
        let found = rules.find(|(of, known, _)| of == device && *known == rule);
        found.map_or(0, |(.., count)| *count)
    }

    /// Adds the violations between two moments.
    fn add(&mut self, [before, now]: &[Self; 2]) {
        self.total += now.total.saturating_sub(before.total);
        for (device, rule, count) in &now.rules {
            let more = count.saturating_sub(before.count(device, rule));
            let mut rules = self.rules.iter_mut();
            match rules.find(|(of, known, _)| of == device && known == rule) {
                Some((.., sum)) => *sum += more,
                None => self.rules.push((device.clone(), rule, more)),
            }
        }
    }
}

impl ViolationsLater {
    /// The checker of the expectations of `scenario`, whose robot has these links to its station;
    /// `None` if they judge the whole run.
    pub fn of(scenario: &Scenario, station: &'static [&'static str]) -> Option<Self> {
        let expect = &scenario.expect;
        let safety = expect.safety.as_ref();
        let steps = scenario.mission.step.iter();
        let connects = steps.filter(|step| step.action == Action::Connect);
        let connected = connects.filter_map(|step| step.at);
        let connected = connected.chain(Some(scenario.mission.connect)).max();
        let connected = connected.map(|at| at.instant());
        let broken = safety.map_or(Vec::new(), |safety| safety.alive_without.clone());
        Some(Self {
            station,
            connected,
            unconnected: unconnected(&scenario.fault, &broken, station, connected),
            max: expect.violations_max?,
            from: expect.violations_from?.instant(),
            exempt: broken,
            ends: None,
            disconnects: (scenario.mission.step.iter())
                .any(|step| step.action == Action::Disconnect),
            has_late_order: has_late_order(scenario, expect.violations_from?.instant()),
            faults: times(&scenario.fault),
            tallies: None,
            found: Tally::default(),
            is_observed: false,
            has_come: false,
        })
    }
}

/// The devices at the ends of `links`.
fn ends(rig: &Rig, links: &[String]) -> Vec<String> {
    let broken = rig.links().iter().filter(|link| links.contains(&link.name));
    let nodes = broken.flat_map(|link| link.lines.iter().map(|line| line.from.node));
    nodes.map(|node| rig.node_name(node).to_owned()).collect()
}

/// Whether the station of `scenario` gives an order at or after `from`.
fn has_late_order(scenario: &Scenario, from: Instant) -> bool {
    let mut steps = scenario.mission.step.iter();
    steps.any(|step| step.at.is_none_or(|at| at.instant() >= from))
}

/// Start of each of `faults` that has begun or will begin at its time and has an end, and the end
/// of its effects.
fn times(faults: &[FaultSpec]) -> Vec<[Instant; 2]> {
    let faults = faults
        .iter()
        .filter(|fault| !fault.waits_for_condition() && !fault.waits_for_trigger());
    let times = faults.filter_map(|fault| {
        let Window { from, until } = fault.window();
        (until < Window::ALWAYS.until).then(|| [from, until + EFFECTS])
    });
    times.collect()
}

/// Devices of the station without a connection: their bytes, or the answers to them, do not arrive.
/// Such a device is behind another one that was without power, as the PC behind its radio, and no
/// step has connected it again; or it is behind a link that is `broken` to the end.
fn unconnected(
    faults: &[FaultSpec],
    broken: &[String],
    station: &'static [&'static str],
    connected: Option<Instant>,
) -> Vec<&'static str> {
    use FaultKind::{Intermittent, Off, PowerDip, Restart};
    let ends = faults
        .iter()
        .filter(|fault| matches!(fault.kind, Intermittent | Off | PowerDip | Restart));
    let ends: Vec<_> = ends.map(|fault| (fault, fault.window().from)).collect();
    let is_hit = |link: &str| {
        if broken.iter().any(|one| one == link) {
            return true;
        }
        let mut hits = ends.iter().filter(|(fault, _)| fault.is_at(link));
        hits.any(|(fault, from)| {
            fault.waits_for_condition() || connected.is_none_or(|connected| connected <= *from)
        })
    };
    // The links of a station are in order, that of the robot's radio before the PC's.
    let behind = station.iter().skip_while(|link| !is_hit(link)).skip(1);
    behind.copied().collect()
}

impl Checker for ViolationsLater {
    fn observe(&mut self, look: &Look<'_>) {
        let (rig, now) = (look.rig, look.rig.now());
        self.ends.get_or_insert_with(|| ends(rig, &self.exempt));
        let mut faults = self.faults.iter();
        let counts =
            now >= self.from && !faults.any(|[from, until]| (*from..*until).contains(&now));
        match &mut self.tallies {
            Some(tallies) if !counts => {
                self.found.add(tallies);
                self.tallies = None;
            }
            None if counts => self.tallies = Some([Tally::of(rig), Tally::of(rig)]),
            Some([_, now]) if now.total != rig.violations() => *now = Tally::of(rig),
            _ => {}
        }
        self.is_observed |= counts;
        self.has_come |= now >= self.from;
    }

    fn verdict(&self) -> Check {
        let from = self.from;
        if !self.is_observed {
            let detail = match self.has_come {
                true => format!("from {from} s on, faults and their effects lasted to the end"),
                false => format!("the run ended before {from} s, the time of the judgement"),
            };
            return Check::not_observed(VIOLATIONS, detail);
        }
        let mut all = self.found.clone();
        if let Some(tallies) = &self.tallies {
            all.add(tallies);
        }
        let (mut exempt, mut words) = (0, Vec::new());
        for (device, rule, count) in &all.rules {
            let at_broken = self.ends.as_ref().is_some_and(|ends| ends.contains(device));
            let is_earlier = !self.has_late_order && rule.ends_with("-not-confirmed");
            let is_closed = self.disconnects && *rule == "host-port-closed";
            let is_exempt = self.exempt.contains(device)
                || at_broken
                || is_closed
                || is_earlier
                || self.unconnected.contains(&device.as_str());
            match is_exempt {
                true => exempt += count,
                false if *count > 0 => words.push(format!("{count} times {rule} of {device}")),
                false => {}
            }
        }
        let (found, max) = (all.total.saturating_sub(exempt), self.max);
        let mut detail = format!("{found} broken rules from {from} s on, at most {max}");
        if found > 0 {
            detail += &format!(": {}", words.join(", "));
        }
        if exempt > 0 {
            detail += &format!(
                "; not counted: {exempt} of devices behind a fault that lasts, or without connection"
            );
        }
        Check::new(VIOLATIONS, found <= max, detail)
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], _rig: &Rig) {
        self.faults = times(faults);
        self.unconnected = unconnected(faults, &self.exempt, self.station, self.connected);
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(self.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A restart of the radio at 38 s ends the connection of the PC: a missing answer is not the
    /// robot's mistake, until a step connects the PC again. A restart of the lidar changes nothing.
    #[test]
    fn a_pc_behind_a_restarted_radio_waits_in_vain() {
        const STATION: &[&str] = &["radio", "pc"];
        let with = |broken: &str, device: &str, from: &str, steps: &str| {
            let text = format!(
                "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"60s\"\n\
                 [expect]\nviolations_max = 0\nviolations_from = \"56s\"\n\
                 [expect.safety]\nalive_without = [{broken}]\n\
                 [world]\nstart = {{ x_m = 1, y_m = 1, heading_deg = 0 }}\n\
                 [[fault]]\nkind = \"restart\"\ndevice = \"{device}\"\nfrom = \"{from}\"\n\
                 [mission]\n{steps}"
            );
            let (scenario, _) = Scenario::from_text(&text).expect("sound");
            ViolationsLater::of(&scenario, STATION).expect("later")
        };
        let of = |device: &str, steps: &str| with("", device, "38s", steps);
        let connect = |at: u32| format!("[[mission.step]]\nat = \"{at}s\"\ndo = \"connect\"\n");
        assert_eq!(of("radio", "").unconnected, ["pc"]);
        assert_eq!(of("radio", &connect(20)).unconnected, ["pc"]);
        assert_eq!(of("radio", &connect(40)).unconnected, [""; 0]);
        assert_eq!(of("lidar", "").unconnected, [""; 0]);
        // A radio whose link is broken to the end.
        assert_eq!(with("\"radio\"", "lidar", "38s", "").unconnected, ["pc"]);
        // The radio is not behind the PC, and the PC connects after 500 ms.
        assert_eq!(with("\"pc\"", "lidar", "38s", "").unconnected, [""; 0]);
        assert_eq!(with("", "radio", "100ms", "").unconnected, [""; 0]);
    }

    /// Three things are exempt: devices at the ends of a link that stays broken, whatever their
    /// names; a closed port, if the station itself disconnects; and an order that is not confirmed,
    /// if none was given after the time with faults. Anything else counts.
    #[test]
    fn only_what_the_run_itself_explains_is_exempt() {
        let judged = |broken: &str, steps: &str, broken_rules: &[(&str, &'static str)]| {
            let text = format!(
                "schema = 1\nname = \"t\"\nrobot = \"rescue\"\nduration = \"60s\"\n\
                 [expect]\nviolations_max = 0\nviolations_from = \"56s\"\n\
                 [expect.safety]\nalive_without = [{broken}]\n\
                 [world]\nstart = {{ x_m = 1, y_m = 1, heading_deg = 0 }}\n[mission]\n{steps}"
            );
            let (scenario, source) = Scenario::from_text(&text).expect("sound");
            let run = crate::run::Run::new(scenario.clone(), &source, None).expect("wired");
            let mut later = ViolationsLater::of(&scenario, &["radio", "pc"]).expect("later");
            later.ends = Some(ends(&run.rig, &later.exempt));
            later.is_observed = true;
            later.found.total = broken_rules.len() as u64;
            let rules = broken_rules.iter();
            later.found.rules = rules.map(|&(of, rule)| (of.to_owned(), rule, 1)).collect();
            later.verdict().status
        };
        use super::super::Status::{Fail, Pass};
        let step = |at: u32, what: &str| format!("[[mission.step]]\nat = \"{at}s\"\ndo = {what}\n");
        let gone = step(20, "\"disconnect\"") + &step(22, "\"connect\"");
        let (full, closed) = (("radio", "fifo-overflow"), ("radio", "host-port-closed"));
        let unsure = ("pc", "order-not-confirmed");
        // The radio is at one end of the link `pc`.
        assert_eq!(judged("\"pc\"", "", &[full]), Pass);
        assert_eq!(judged("\"base\"", "", &[full]), Fail);
        assert_eq!(judged("", &gone, &[closed]), Pass);
        assert_eq!(
            [judged("", "", &[closed]), judged("", &gone, &[full])],
            [Fail; 2]
        );
        assert_eq!(judged("", &gone, &[unsure]), Pass);
        let late = step(57, "{ mode = \"stop\" }");
        assert_eq!(judged("", &late, &[unsure]), Fail);
        assert_eq!(judged("", &late, &[closed]), Fail);
    }

    use super::super::Status;
    use super::super::safety::puppet::{copied, cut, puppet};
    use super::super::safety::tests::look_at;
    use emulators::{Event, EventKind};

    fn broken(rig: &mut Rig, source: &str, rule: &'static str) {
        let event = Event {
            at: rig.now(),
            kind: EventKind::Violation,
            rule,
            detail: "so".to_owned(),
            bytes: Vec::new(),
        };
        rig.log(source, event);
    }

    /// Without a program or a byte to a device nothing was observed, unless a rule was broken.
    #[test]
    fn broken_rules_of_the_whole_run_are_counted() {
        let mut rig = crate::rig::bare::rig();
        let told = |max, rig: &Rig| {
            let check = violations(max, rig);
            (check.status, check.detail)
        };
        let none = "no device received a byte".to_owned();
        assert_eq!(told(0, &rig), (Status::NotObserved, none));
        puppet(&mut rig);
        let sound = "0 broken rules, at most 0".to_owned();
        assert_eq!(told(0, &rig), (Status::Pass, sound));
        let mut rig = crate::rig::bare::rig();
        broken(&mut rig, "base", "too-soon");
        broken(&mut rig, "base", "too-late");
        let (status, detail) = told(1, &rig);
        assert_eq!(status, Status::Fail);
        let begin = "2 broken rules, at most 1; first: ";
        assert!(
            detail.starts_with(begin) && detail.contains("too-soon"),
            "{detail}"
        );
        assert_eq!(told(2, &rig).0, Status::NotObserved);
    }

    fn later(rig: &Rig, max: u64, faults: &[FaultSpec]) -> ViolationsLater {
        let text = format!("[expect]\nviolations_max = {max}\nviolations_from = \"10s\"\n");
        let (scenario, _) = super::super::safety::puppet::scenario(&text);
        let mut later = ViolationsLater::of(&scenario, &["radio", "pc"]).expect("later");
        later.faults_changed(faults, rig);
        later
    }

    /// Violations count from 10 s on, but for a fault from 20 to 21 s and its effects to 26 s.
    fn judged(max: u64, seconds: &[u64], until: u64) -> (Status, String) {
        let (mut rig, _) = crate::rig::bare::linked(["base"], 1_000_000);
        let mut later = later(&rig, max, &[cut("base", 20, 21)]);
        for second in 1..=until {
            look_at(&mut later, &mut rig, 1_000 * second, 0.0);
            if seconds.contains(&second) {
                broken(&mut rig, "base", "too-soon");
            }
            look_at(&mut later, &mut rig, 1_000 * second + 500, 0.0);
        }
        let check = later.verdict();
        assert_eq!(copied(&later, &rig), check.to_string());
        (check.status, check.detail)
    }

    #[test]
    fn violations_count_while_no_fault_acts() {
        let words = |found, more: &str| {
            format!("{found} broken rules from 10.000000 s on, at most 1{more}")
        };
        assert_eq!(judged(1, &[9, 20, 25], 40), (Status::Pass, words(0, "")));
        let one = words(1, ": 1 times too-soon of base");
        assert_eq!(judged(1, &[5, 10, 22], 40), (Status::Pass, one.clone()));
        assert_eq!(judged(1, &[26], 40), (Status::Pass, one.clone()));
        assert_eq!(judged(1, &[19], 40), (Status::Pass, one));
        let three = words(3, ": 3 times too-soon of base");
        assert_eq!(
            judged(1, &[11, 19, 21, 30], 40),
            (Status::Fail, three.clone())
        );
        assert_eq!(judged(1, &[30, 31, 32], 32), (Status::Fail, three));
        let early = "the run ended before 10.000000 s, the time of the judgement".to_owned();
        assert_eq!(judged(1, &[3], 9), (Status::NotObserved, early));
    }

    #[test]
    fn a_fault_to_the_end_leaves_nothing_to_judge() {
        let (mut rig, _) = crate::rig::bare::linked(["base"], 1_000_000);
        let mut later = later(&rig, 0, &[cut("base", 9, 21)]);
        for second in [9, 10, 20] {
            look_at(&mut later, &mut rig, 1_000 * second, 0.0);
        }
        let check = later.verdict();
        let words = "from 10.000000 s on, faults and their effects lasted to the end";
        assert_eq!((check.status, &*check.detail), (Status::NotObserved, words));
    }

    /// Rules differ by device and name; exempt ones are not counted.
    #[test]
    fn each_rule_of_each_device_is_told() {
        let (mut rig, _) = crate::rig::bare::linked(["base"], 1_000_000);
        let mut later = later(&rig, 1, &[]);
        later.exempt = vec!["lidar".to_owned()];
        // Those of the time before do not count, of no device.
        broken(&mut rig, "base", "too-soon");
        broken(&mut rig, "base", "too-soon");
        look_at(&mut later, &mut rig, 10_000, 0.0);
        for (device, rule) in [
            ("base", "too-soon"),
            ("arm", "too-soon"),
            ("base", "too-late"),
            ("base", "too-soon"),
            ("lidar", "too-soon"),
        ] {
            broken(&mut rig, device, rule);
        }
        look_at(&mut later, &mut rig, 11_000, 0.0);
        let words = "4 broken rules from 10.000000 s on, at most 1: 2 times too-soon of base, 1 \
                     times too-soon of arm, 1 times too-late of base; not counted: 1 of devices \
                     behind a fault that lasts, or without connection";
        assert_eq!(later.verdict().detail, words);
    }

    /// The expectations have both a number and a time; an order at 56 s is late for 56 s.
    #[test]
    fn only_a_scenario_with_a_time_is_judged_from_then_on() {
        let of = |keys: &str| {
            let (scenario, _) = super::super::safety::puppet::scenario(keys);
            ViolationsLater::of(&scenario, &[]).is_some()
        };
        assert!(!of(""));
        assert!(!of("[expect]\nviolations_max = 0\n"));
        let late = |at: u32| {
            let step =
                format!("[mission]\nstep = [{{ at = \"{at}s\", do = {{ mode = \"stop\" }} }}]\n");
            let (scenario, _) = super::super::safety::puppet::scenario(&step);
            has_late_order(&scenario, Instant::from_secs(56))
        };
        assert_eq!([late(55), late(56)], [false, true]);
        let waiting = "[mission]\nwaypoints_m = [[1, 2]]\n\
                       step = [{ when = { visited = 1 }, do = { mode = \"stop\" } }]\n";
        let (scenario, _) = super::super::safety::puppet::scenario(waiting);
        assert!(has_late_order(&scenario, Instant::from_secs(56)));
    }

    /// Only a fault with an end has effects that end, 5 s later.
    #[test]
    fn faults_without_an_end_do_not_excuse() {
        let mut open = cut("base", 3, 4);
        open.until = None;
        let mut waits = cut("base", 3, 4);
        waits.at_byte = Some(9);
        let at = Instant::from_secs;
        assert_eq!(times(&[cut("base", 3, 4), open, waits]), [[at(3), at(9)]]);
    }
}
