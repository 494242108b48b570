//! Checks that the program continues to send while other links fail.

use core::time::Duration;

use protocols::Instant;

use super::super::{Check, Checker, Look};
use super::Calm;
use crate::rig::Rig;
use crate::rig::line::Direction;
use crate::robots::Instruments;
use crate::scenario::{FaultSpec, Scenario};

/// Time in which a line is observed before it is judged. The program uses it steadily if, in this
/// time, it sends enough bytes and is never silent for longer than a quarter of the limit.
const OBSERVED: Duration = Duration::from_secs(5);
/// Minimum number of bytes in this time. A motor duty that is sent only when it changes has fewer
/// bytes.
const BYTES_MIN: u64 = 100;

/// On each line that it uses steadily the program continues to send, as long as no fault acts on
/// this line: a failed device does not block the others.
pub struct SendsOn {
    within: Duration,
    watched: Vec<Watched>,
    broken: Option<(Instant, String)>,
}

#[derive(Clone, Debug)]
struct Watched {
    link: usize,
    name: String,
    calm: Calm,
    sent: u64,
    sent_at: Instant,
    /// Start of the steady use, and the number of bytes then.
    steady_since: Option<(Instant, u64)>,
    longest: Duration,
}

impl SendsOn {
    /// Observes the lines of the program in `rig`; it must not be silent for longer than `within`.
    /// A line with sporadic messages may be silent.
    pub fn new(
        scenario: &Scenario,
        rig: &Rig,
        instruments: &dyn Instruments,
        within: Duration,
    ) -> Self {
        let sporadic = instruments.sporadic_links();
        let name = |link: usize| rig.links()[link].name.clone();
        let links = rig.links_under_test(instruments.station_links());
        let links = links.into_iter();
        let links = links.filter(|&link| !sporadic.contains(&&*name(link)));
        let watched = links.map(|link| {
            let name = name(link);
            Watched {
                link,
                calm: Calm::of(scenario, rig, &|other| other == name),
                name,
                sent: 0,
                sent_at: Instant::ZERO,
                steady_since: None,
                longest: Duration::ZERO,
            }
        });
        Self {
            within,
            watched: watched.collect(),
            broken: None,
        }
    }
}

impl Watched {
    fn is_steady(&self, now: Instant) -> bool {
        self.steady_since.is_some_and(|(since, before)| {
            now - since >= OBSERVED && self.sent >= before + BYTES_MIN
        })
    }

    /// Returns the silence if it is too long.
    fn observe(&mut self, now: Instant, sent: u64, within: Duration) -> Option<Duration> {
        let silence = now - self.sent_at;
        if !self.calm.is(now) {
            (self.sent, self.sent_at, self.steady_since) = (sent, now, None);
            return None;
        }
        let is_steady = self.is_steady(now);
        if sent != self.sent {
            (self.sent, self.sent_at) = (sent, now);
            self.steady_since.get_or_insert((now, sent));
        }
        if is_steady {
            self.longest = self.longest.max(silence);
            return (silence > within).then_some(silence);
        }
        if silence > within / 4 {
            self.steady_since = None;
        }
        None
    }
}

impl Checker for SendsOn {
    fn observe(&mut self, look: &Look<'_>) {
        let now = look.rig.now();
        if self.broken.is_some() {
            return;
        }
        for one in &mut self.watched {
            let link = look.rig.links().get(one.link);
            let sent = link.map_or(0, |link| link.line(Direction::ToDevice).traffic().sent);
            if let Some(silence) = one.observe(now, sent, self.within) {
                let seconds = silence.as_secs_f64();
                let told = format!("nothing was sent on {} for {seconds:.1} s", one.name);
                self.broken = Some((now, told));
            }
        }
    }

    fn verdict(&self) -> Check {
        let name = "sends-on";
        let judged = self
            .watched
            .iter()
            .filter(|one| one.longest > Duration::ZERO);
        let longest = judged.clone().map(|one| one.longest).max();
        let detail = match (&self.broken, longest) {
            (Some((at, told)), _) => format!("at {at} s {told}, without a fault on this link"),
            (None, None) => "no line that the program uses steadily".to_owned(),
            (None, Some(longest)) => format!(
                "{} lines, silent for at most {} ms",
                judged.count(),
                longest.as_millis()
            ),
        };
        Check::new(name, self.broken.is_none(), detail).if_observed(longest.is_some())
    }

    fn faults_changed(&mut self, faults: &[FaultSpec], rig: &Rig) {
        for one in &mut self.watched {
            one.calm.renew(faults, rig);
        }
    }

    fn fork(&self, _rig: &mut Rig) -> Option<Box<dyn Checker>> {
        Some(Box::new(Self {
            within: self.within,
            watched: self.watched.clone(),
            broken: self.broken.clone(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WITHIN: Duration = Duration::from_secs(2);

    fn watched() -> Watched {
        Watched {
            link: 0,
            name: "base".to_owned(),
            calm: Calm::default(),
            sent: 0,
            sent_at: Instant::ZERO,
            steady_since: None,
            longest: Duration::ZERO,
        }
    }

    /// Sends this number of bytes each 100 ms between these tenths of a second.
    fn sends(one: &mut Watched, tenths: core::ops::Range<u64>, bytes: u64) {
        for tenth in tenths {
            let sent = one.sent + bytes;
            assert_eq!(
                one.observe(Instant::from_millis(100 * tenth), sent, WITHIN),
                None
            );
        }
    }

    fn silent_at(one: &mut Watched, millis: u64) -> Option<Duration> {
        let sent = one.sent;
        one.observe(Instant::from_millis(millis), sent, WITHIN)
    }

    /// Ten bytes each 100 ms for five seconds are a steady use; then two seconds of silence are
    /// allowed.
    #[test]
    fn a_line_in_steady_use_is_not_silent() {
        let mut one = watched();
        sends(&mut one, 1..61, 10);
        assert_eq!(one.longest, Duration::from_millis(100));
        assert_eq!(silent_at(&mut one, 8_000), None);
        assert_eq!(
            silent_at(&mut one, 8_001),
            Some(Duration::from_millis(2_001))
        );
    }

    /// There is no steady use after less than five seconds, with less than 100 bytes after the
    /// first ones, or with a pause of more than half a second.
    #[test]
    fn other_lines_are_not_judged() {
        let after = |tenths, bytes| {
            let mut one = watched();
            sends(&mut one, tenths, bytes);
            silent_at(&mut one, 60_000)
        };
        let mut short = watched();
        sends(&mut short, 1..51, 10);
        assert_eq!(silent_at(&mut short, 5_099), None);
        assert_eq!(short.longest, Duration::ZERO);
        assert_eq!(silent_at(&mut short, 5_100), None);
        assert_eq!(short.longest, Duration::from_millis(100));
        assert_eq!((after(1..101, 1), after(1..102, 1).is_some()), (None, true));
        let mut one = watched();
        sends(&mut one, 1..31, 10);
        assert_eq!(silent_at(&mut one, 3_501), None);
        sends(&mut one, 36..86, 10);
        assert_eq!(one.longest, Duration::ZERO);
        let mut one = watched();
        sends(&mut one, 1..31, 10);
        sends(&mut one, 35..55, 10);
        assert!(one.longest > Duration::ZERO);
    }

    use super::super::puppet::{copied, cut, scenario};
    use super::super::tests::look_at;
    use crate::rig::bare::linked;
    use crate::robots::checker::Status;

    struct Robot;

    impl Instruments for Robot {
        fn sporadic_links(&self) -> &'static [&'static str] {
            &["markers"]
        }

        fn station_links(&self) -> &'static [&'static str] {
            &["pc"]
        }
    }

    /// Bytes each 100 ms until 6 s on both lines, then on the other one alone, or on none.
    fn judged(silent: &str, fault: Option<FaultSpec>) -> (Status, String) {
        let (mut rig, ends) = linked(["base", "markers"], 1_000_000);
        let (scenario, _) = scenario("");
        let mut checker = SendsOn::new(&scenario, &rig, &Robot, WITHIN);
        checker.faults_changed(&fault.into_iter().collect::<Vec<_>>(), &rig);
        for tenth in 1..=81_u64 {
            for (name, ends) in ["base", "markers"].into_iter().zip(ends) {
                if tenth <= 60 || name != silent {
                    rig.inject(ends[1].node, &[7; 10]);
                }
            }
            rig.inject(ends[0][0].node, &[7]);
            look_at(&mut checker, &mut rig, 100 * tenth, 0.0);
        }
        let check = checker.verdict();
        assert_eq!(copied(&checker, &rig), check.to_string());
        (check.status, check.detail)
    }

    /// Two seconds of silence are allowed; the markers' line may be silent.
    #[test]
    fn a_line_that_falls_silent_is_told() {
        let steady = "1 lines, silent for at most 100 ms".to_owned();
        assert_eq!(judged("none", None), (Status::Pass, steady.clone()));
        assert_eq!(judged("markers", None), (Status::Pass, steady));
        let silent =
            "at 8.100000 s nothing was sent on base for 2.1 s, without a fault on this link";
        assert_eq!(judged("base", None), (Status::Fail, silent.to_owned()));
        let none = "no line that the program uses steadily".to_owned();
        assert_eq!(
            judged("base", Some(cut("base", 1, 20))),
            (Status::NotObserved, none)
        );
        assert_eq!(judged("base", Some(cut("other", 1, 20))).0, Status::Fail);
    }

    /// During a fault nothing is judged, and the use is not steady any more.
    #[test]
    fn a_fault_begins_the_use_anew() {
        let mut one = watched();
        sends(&mut one, 1..61, 10);
        one.calm = {
            let (rig, _) = linked(["base"], 1_000_000);
            let (scenario, _) = scenario("");
            let mut calm = Calm::of(&scenario, &rig, &|_| true);
            calm.renew(&[cut("base", 7, 8)], &rig);
            calm
        };
        assert_eq!(silent_at(&mut one, 12_900), None);
        assert_eq!((one.sent_at.as_millis(), one.steady_since), (12_900, None));
        assert_eq!(silent_at(&mut one, 60_000), None);
    }
}
