//! What is seen of a program at its ports: which it opens, and whether it goes on reading.

use core::time::Duration;

use protocols::Instant;

use crate::Sign;
use engine::run::check::Check;

/// Rig time for which bytes may wait at an open port of which nothing is read.
const UNREAD_MAX: Duration = Duration::from_secs(2);
/// Rig time after which it is worth a look why a program does not read.
const UNREAD_LONG: Duration = Duration::from_millis(100);

/// One port.
#[derive(Clone, Debug, Default)]
struct Port {
    name: String,
    is_needed: bool,
    was_opened: bool,
    is_open: bool,
    speaks: bool,
    reads: Option<u64>,
    /// Rig time since its last reading, as long as the rig was on time and bytes waited.
    unread_for: Duration,
    hangs_at: Option<Instant>,
}

/// All ports at which clients can be seen.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ports {
    all: Vec<Port>,
    longest: Duration,
}

impl Ports {
    /// Another port.
    pub(crate) fn add(&mut self, name: &str, is_needed: bool) {
        self.all.push(Port {
            name: name.to_owned(),
            is_needed,
            ..Port::default()
        });
    }

    /// Takes note of `sign` at the rig's `now`, `on_time` after the last one: zero if the rig was
    /// late, because then the program may have been as well, or if the machine held the program up.
    pub(crate) fn observe(&mut self, now: Instant, on_time: Duration, sign: &Sign<'_>) {
        let Some(port) = self.all.iter_mut().find(|port| port.name == sign.name) else {
            return;
        };
        port.is_open = sign.is_open;
        port.was_opened |= sign.is_open;
        port.speaks |= sign.from_client > 0;
        let has_read = sign.reads != port.reads;
        port.reads = sign.reads;
        if !sign.is_open || sign.is_drained || has_read || sign.reads.is_none() {
            port.unread_for = Duration::ZERO;
            return;
        }
        port.unread_for += on_time;
        self.longest = self.longest.max(port.unread_for);
        if port.unread_for > UNREAD_MAX && port.hangs_at.is_none() {
            port.hangs_at = Some(now);
        }
    }

    /// Whether bytes have waited at one of them for longer than is usual.
    pub(crate) fn any_waits_long(&self) -> bool {
        self.all.iter().any(|port| port.unread_for > UNREAD_LONG)
    }

    /// How many were opened so far.
    pub(crate) fn opened(&self) -> usize {
        self.all.iter().filter(|port| port.was_opened).count()
    }

    /// Whether any is open now.
    pub(crate) fn any_open(&self) -> bool {
        self.all.iter().any(|port| port.is_open)
    }

    /// Whether the program has sent anything.
    pub(crate) fn any_speaks(&self) -> bool {
        self.all.iter().any(|port| port.speaks)
    }

    /// Whether all that the program needs was opened: one at least, if there is any.
    pub(crate) fn is_complete(&self) -> bool {
        let needs_more = |port: &Port| port.is_needed && !port.was_opened;
        !self.all.iter().any(needs_more) && (self.all.is_empty() || self.opened() > 0)
    }

    fn names(&self, is: impl Fn(&Port) -> bool) -> String {
        let those = self.all.iter().filter(|port| is(port));
        let names: Vec<&str> = those.map(|port| port.name.as_str()).collect();
        names.join(", ")
    }

    /// The verdict on what was opened.
    pub(crate) fn connected(&self, wait: Duration) -> Check {
        let opened = self.names(|port| port.was_opened);
        let missing = self.names(|port| port.is_needed && !port.was_opened);
        let detail = match (self.all.is_empty(), opened.is_empty(), missing.is_empty()) {
            (true, ..) => "its ports are real ones: who opens them cannot be seen".to_owned(),
            (_, true, _) => {
                let all = self.names(|port| port.is_needed || missing.is_empty());
                format!("opened none of {all} within {} s", wait.as_secs_f64())
            }
            (_, _, false) => format!("never opened {missing}; opened {opened}"),
            (_, _, true) => format!("opened {opened}"),
        };
        Check::new("program-connected", self.is_complete(), detail)
    }

    /// The verdict on its reading.
    pub(crate) fn reads(&self) -> Check {
        let hangs: Vec<String> = self
            .all
            .iter()
            .filter_map(|port| Some(format!("{} at {} s", port.name, port.hangs_at?)))
            .collect();
        let most = UNREAD_MAX.as_secs_f64();
        let detail = if !hangs.is_empty() {
            let hangs = hangs.join(", ");
            format!("hangs: bytes waited and it read nothing for {most} s: {hangs}")
        } else if self.all.iter().all(|port| port.reads.is_none()) {
            "no port at which reading can be seen".to_owned()
        } else {
            let longest = self.longest.as_secs_f64();
            format!("bytes waited unread for {longest:.2} s at most, limit {most} s")
        };
        Check::new("program-reads", hangs.is_empty(), detail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::run::check::Status;

    const STEP: Duration = Duration::from_millis(10);

    /// A port that is always filled, looked at each 10 ms for `looks` times; the program reads at
    /// every `reads_each`-th look, and the rig was on time for `on_time` of each.
    fn watched(looks: u64, reads_each: u64, on_time: Duration) -> Ports {
        let mut ports = Ports::default();
        ports.add("base", true);
        for look in 1..=looks {
            let sign = Sign {
                name: "base",
                is_open: true,
                openings: 1,
                from_client: 0,
                is_drained: false,
                reads: Some(look / reads_each),
            };
            ports.observe(
                Instant::ZERO + STEP * u32::try_from(look).expect("few looks"),
                on_time,
                &sign,
            );
        }
        ports
    }

    #[test]
    fn who_never_reads_is_named_with_its_port() {
        let check = watched(400, u64::MAX, STEP).reads();
        assert_eq!(check.status, Status::Fail);
        assert!(check.detail.contains("base at 2.02"), "{}", check.detail);
    }

    /// It takes a little each 1.5 s, so there are always bytes that wait.
    #[test]
    fn who_reads_slowly_but_steadily_does_not_hang() {
        let check = watched(2000, 150, STEP).reads();
        assert_eq!(check.status, Status::Pass, "{}", check.detail);
    }

    #[test]
    fn nobody_is_charged_for_time_in_which_the_rig_was_late() {
        let check = watched(2000, u64::MAX, Duration::ZERO).reads();
        assert_eq!(check.status, Status::Pass, "{}", check.detail);
    }

    #[test]
    fn ports_that_were_never_opened_are_named() {
        let mut ports = watched(1, 1, STEP);
        ports.add("lidar", true);
        ports.add("motor", false);
        let wait = Duration::from_secs(10);
        let check = ports.connected(wait);
        assert_eq!(check.detail, "never opened lidar; opened base");
        assert_eq!(check.status, Status::Fail);
        let mut none = Ports::default();
        none.add("lidar", true);
        none.add("motor", false);
        let check = none.connected(wait);
        assert_eq!(check.detail, "opened none of lidar within 10 s");
        assert_eq!(check.status, Status::Fail);
    }
}
