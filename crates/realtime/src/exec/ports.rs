//! Observations of a program at its ports: which ports it opens, and whether it continues to read.

use core::time::Duration;

use protocols::Instant;

use std::path::PathBuf;

use crate::Sign;
use crate::garbled::Garbled;
use crate::transport::{Counters, Modes, Special};
use engine::run::check::{Check, PAUSES_MAX};
use engine::scenario::{DirectionSpec, FaultKind, FaultSpec};

/// Maximum rig time for which bytes may wait at an open port without a read.
const UNREAD_MAX: Duration = Duration::from_secs(2);
/// Rig time without a read after which the machine's load is checked.
const UNREAD_LONG: Duration = Duration::from_millis(100);

/// One port.
#[derive(Clone, Debug, Default)]
pub(crate) struct Port {
    pub(super) name: String,
    /// The terminal behind its name.
    pub(super) path: PathBuf,
    pub(super) is_needed: bool,
    pub(super) was_opened: bool,
    pub(super) is_open: bool,
    pub(super) reads: Option<u64>,
    /// Rig time since the last read while bytes waited; time in which the rig was late does not
    /// count.
    unread_for: Duration,
    /// The longest such time after which the program read again.
    longest: Duration,
    pub(super) hangs_at: Option<Instant>,
    pub(super) from_client: u64,
    pub(super) to_client: u64,
    pub(super) lost: Counters,
    pub(super) special: [Special; 2],
    /// All settings that were on in the client's terminal while bytes passed.
    pub(super) settings: Modes,
    pub(super) settings_now: Modes,
    /// Rates of client and device while the port is open, if they do not understand each other.
    pub(super) wrong_rate: Option<(u32, u32)>,
    /// The first pair of different rates, and its time.
    pub(super) was_wrong: Option<(u32, u32, Instant)>,
    /// Bytes that passed at different rates.
    pub(super) garbled: Garbled,
    /// Rig time for which the port was open, and open at a wrong rate.
    pub(super) open_for: [Duration; 2],
    /// Times of the client's last write, its last read, and the device's last bytes to it.
    pub(super) sent_at: Option<Instant>,
    pub(super) read_at: Option<Instant>,
    pub(super) heard_at: Option<Instant>,
    seen_at: Instant,
    /// Numbers of bytes from the client and to it, with the times of the first and the last
    /// observation of these numbers.
    passed: Vec<([Instant; 2], [u64; 2])>,
}

/// All ports with visible clients.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ports {
    pub(super) all: Vec<Port>,
    longest: Duration,
    /// Time of the program's last write or read, and the longest pause before that.
    pub(super) active_at: Option<Instant>,
    pub(super) longest_pause: Duration,
}

impl Ports {
    /// Adds a port whose terminal is at `path`.
    pub(crate) fn add(&mut self, name: &str, path: PathBuf, is_needed: bool) {
        self.all.push(Port {
            name: name.to_owned(),
            path,
            is_needed,
            ..Port::default()
        });
    }

    /// Records `sign` at the rig's `now`. `on_time` is the time since the last call. It is zero if
    /// the rig was late, because the program may have been late too, or if the machine delayed the
    /// program.
    pub(crate) fn observe(&mut self, now: Instant, on_time: Duration, sign: &Sign<'_>) {
        let Some(port) = self.all.iter_mut().find(|port| port.name == sign.name) else {
            return;
        };
        let has_read = port.note(now, sign);
        if has_read || port.sent_at == Some(now) {
            let before = self.active_at.replace(now).unwrap_or(now);
            self.longest_pause = self.longest_pause.max(now - before);
        }
        if !sign.is_open || sign.is_drained || has_read || sign.reads.is_none() {
            let waited = core::mem::take(&mut port.unread_for);
            // The program has read or flushed at last, and no waiting byte was lost.
            if (has_read || sign.is_drained) && sign.is_open && sign.lost.overrun == 0 {
                port.hangs_at = None;
                port.longest = port.longest.max(waited);
            }
            return;
        }
        port.unread_for += on_time;
        self.longest = self.longest.max(port.unread_for);
        let most = UNREAD_MAX.max(port.longest * PAUSES_MAX);
        if port.unread_for > most && port.hangs_at.is_none() {
            port.hangs_at = Some(now);
        }
    }

    /// Whether bytes have waited at a port for an unusually long time.
    pub(crate) fn any_waits_long(&self) -> bool {
        self.all.iter().any(|port| port.unread_for > UNREAD_LONG)
    }

    /// Number of ports opened so far.
    pub(crate) fn opened(&self) -> usize {
        self.all.iter().filter(|port| port.was_opened).count()
    }

    /// Whether the program has opened the port `name`.
    pub(super) fn was_opened(&self, name: &str) -> bool {
        let mut ports = self.all.iter();
        ports.any(|port| port.name == name && port.was_opened)
    }

    /// Whether a port is open now.
    pub(crate) fn any_open(&self) -> bool {
        self.all.iter().any(|port| port.is_open)
    }

    /// Whether the program has sent anything.
    pub(crate) fn any_speaks(&self) -> bool {
        self.all.iter().any(|port| port.from_client > 0)
    }

    /// Whether all required ports were opened, and at least one port if there is any.
    pub(crate) fn is_complete(&self) -> bool {
        let needs_more = |port: &Port| port.is_needed && !port.was_opened;
        !self.all.iter().any(needs_more) && (self.all.is_empty() || self.opened() > 0)
    }

    pub(super) fn names(&self, is: impl Fn(&Port) -> bool) -> String {
        let those = self.all.iter().filter(|port| is(port));
        let names: Vec<&str> = those.map(|port| port.name.as_str()).collect();
        names.join(", ")
    }

    /// The verdict on the opened ports. The program had `wait` to open them, or ended before that,
    /// as `ended` describes.
    pub(crate) fn connected(&self, wait: Duration, ended: Option<String>) -> Check {
        let opened = self.names(|port| port.was_opened);
        let missing = self.names(|port| port.is_needed && !port.was_opened);
        let detail = match (self.all.is_empty(), opened.is_empty(), missing.is_empty()) {
            (true, ..) => "its ports are real ones, and their clients cannot be seen".to_owned(),
            (_, true, _) => {
                let all = self.names(|port| port.is_needed || missing.is_empty());
                match ended {
                    Some(ended) => format!("opened none of {all} before it {ended}"),
                    None => format!("opened none of {all} within {} s", wait.as_secs_f64()),
                }
            }
            (_, _, false) => format!("never opened {missing}; opened {opened}"),
            (_, _, true) => format!("opened {opened}"),
        };
        Check::new("program-connected", self.is_complete(), detail)
    }

    /// The verdict on the program's reads.
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
            let limit = match self.longest > UNREAD_MAX {
                true => "and none got lost".to_owned(),
                false => format!("limit {most} s"),
            };
            format!("bytes waited unread for {longest:.2} s at most, {limit}")
        };
        Check::new("program-reads", hangs.is_empty(), detail)
    }
}

impl Port {
    /// Records `sign` at `now`. Returns whether the client has read since the last call.
    fn note(&mut self, now: Instant, sign: &Sign<'_>) -> bool {
        let passed = now - core::mem::replace(&mut self.seen_at, now);
        if self.is_open {
            self.open_for[0] += passed;
            if self.wrong_rate.is_some() {
                self.open_for[1] += passed;
            }
        }
        self.is_open = sign.is_open;
        self.was_opened |= sign.is_open;
        let has_read = sign.reads != self.reads && sign.reads != Some(0);
        self.reads = sign.reads;
        if has_read {
            self.read_at = Some(now);
        }
        self.settings_now = sign.settings.unwrap_or_default();
        if sign.from_client != self.from_client {
            self.sent_at = Some(now);
            self.settings = self.settings.or(self.settings_now);
        }
        // Line settings may hold back bytes that have arrived.
        let has_arrived = sign.special[0].all != self.special[0].all;
        if sign.to_client != self.to_client || has_arrived {
            self.heard_at = Some(now);
            self.settings = self.settings.or(self.settings_now);
        }
        (self.from_client, self.to_client) = (sign.from_client, sign.to_client);
        self.keep_passed(now, [sign.from_client, sign.special[0].all]);
        (self.lost, self.special) = (sign.lost, sign.special);
        self.wrong_rate = sign.wrong_rate;
        self.garbled = sign.garbled;
        if let (Some((own, far)), None) = (sign.wrong_rate, self.was_wrong) {
            self.was_wrong = Some((own, far, now));
        }
        has_read
    }
}

/// Maximum number of stored times per port; when it is reached, every second one is removed.
const PASSED_MAX: usize = 1 << 14;

impl Port {
    fn keep_passed(&mut self, now: Instant, bytes: [u64; 2]) {
        if let Some(([_, until], last)) = self.passed.last_mut()
            && *last == bytes
        {
            *until = now;
            return;
        }
        if self.passed.len() >= PASSED_MAX {
            let mut keeps = false;
            self.passed.retain(|_| {
                keeps = !keeps;
                keeps
            });
        }
        self.passed.push(([now; 2], bytes));
    }

    /// Times at which the client has sent.
    pub(super) fn sent(&self) -> Vec<Instant> {
        let mut before = 0;
        let passed = self.passed.iter();
        let sent = passed.filter(|(_, [sent, _])| core::mem::replace(&mut before, *sent) < *sent);
        sent.map(|([at, _], _)| *at).collect()
    }

    /// Time of the last observation before the byte of `fault` passed, which is one of `faults`;
    /// `None` if it has no byte, or if the byte has not passed. Bytes for the client are counted
    /// behind the faults, so without those that were lost before.
    pub(super) fn struck_at(&self, fault: &FaultSpec, faults: &[FaultSpec]) -> Option<Instant> {
        let byte = fault.byte?;
        let is_from_client = fault.direction == Some(DirectionSpec::ToDevice);
        let is_lost = |other: &&FaultSpec| {
            let is_same = other.link == fault.link && other.direction == fault.direction;
            let is_before = other.byte.is_some_and(|other| other < byte);
            is_same && is_before && other.kind == FaultKind::Drop
        };
        let lost = match is_from_client {
            true => 0,
            false => faults.iter().filter(is_lost).count() as u64,
        };
        self.passed_at(is_from_client, byte - lost)
    }

    /// Time of the last observation before byte number `byte` passed, counted from 0; `None` if the
    /// byte has not passed.
    fn passed_at(&self, is_from_client: bool, byte: u64) -> Option<Instant> {
        let side = usize::from(!is_from_client);
        let index = self
            .passed
            .partition_point(|(_, bytes)| bytes[side] <= byte);
        self.passed.get(index)?;
        let before = index.checked_sub(1).map(|before| self.passed[before].0[1]);
        Some(before.unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::run::check::Status;

    const STEP: Duration = Duration::from_millis(10);

    /// A port that always has bytes, observed every 10 ms for `looks` times. The program reads at
    /// every `reads_each`-th observation, and the rig was on time for `on_time` of each.
    fn watched(looks: u64, reads_each: u64, on_time: Duration, overrun: u64) -> Ports {
        let mut ports = Ports::default();
        ports.add("base", PathBuf::new(), true);
        for look in 1..=looks {
            let sign = Sign {
                name: "base",
                is_open: true,
                openings: 1,
                from_client: 0,
                to_client: 0,
                lost: Counters {
                    overrun,
                    ..Counters::default()
                },
                special: [Special::default(); 2],
                wrong_rate: None,
                garbled: Default::default(),
                settings: None,
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
        let check = watched(400, u64::MAX, STEP, 0).reads();
        assert_eq!(check.status, Status::Fail);
        assert!(check.detail.contains("base at 2.01"), "{}", check.detail);
    }

    /// The program reads a little every 1.5 s, so bytes always wait.
    #[test]
    fn who_reads_slowly_but_steadily_does_not_hang() {
        let check = watched(2000, 150, STEP, 0).reads();
        assert_eq!(check.status, Status::Pass, "{}", check.detail);
    }

    /// A logger that takes a line every 5 s: that is late only if bytes get lost meanwhile.
    #[test]
    fn a_long_pause_is_no_hang_while_no_byte_is_lost() {
        let check = watched(2000, 500, STEP, 0).reads();
        assert_eq!(check.status, Status::Pass, "{}", check.detail);
        assert!(check.detail.ends_with("none got lost"), "{}", check.detail);
        let check = watched(2000, 500, STEP, 1).reads();
        assert_eq!(check.status, Status::Fail, "{}", check.detail);
    }

    #[test]
    fn nobody_is_charged_for_time_in_which_the_rig_was_late() {
        let check = watched(2000, u64::MAX, Duration::ZERO, 0).reads();
        assert_eq!(check.status, Status::Pass, "{}", check.detail);
    }

    #[test]
    fn ports_that_were_never_opened_are_named() {
        let mut ports = watched(1, 1, STEP, 0);
        ports.add("lidar", PathBuf::new(), true);
        ports.add("motor", PathBuf::new(), false);
        let wait = Duration::from_secs(10);
        let check = ports.connected(wait, None);
        assert_eq!(check.detail, "never opened lidar; opened base");
        assert_eq!(check.status, Status::Fail);
        let mut none = Ports::default();
        none.add("lidar", PathBuf::new(), true);
        none.add("motor", PathBuf::new(), false);
        let check = none.connected(wait, None);
        assert_eq!(check.detail, "opened none of lidar within 10 s");
        assert_eq!(check.status, Status::Fail);
    }
}
