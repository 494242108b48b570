//! History of a run for the report: wires, scans and maps. The size is limited for any duration of
//! the run.

use core::time::Duration;
use std::sync::Arc;

use protocols::Instant;

use crate::rig::line::{Direction, Traffic};
use crate::rig::{Link, Rig};
use crate::robots::{Instruments, KeptMap, Overlay};

/// Maximum number of samples of the wires.
const BINS_MAX: u32 = 500;
/// Shortest span of a sample of the wires.
const BIN_MIN: Duration = Duration::from_millis(100);
/// Maximum number of scans kept.
const SCANS_MAX: usize = 200;
/// Maximum number of maps kept.
const MAPS_MAX: usize = 16;
/// Maximum number of overlays kept.
const OVERLAYS_MAX: usize = 32;
/// Points kept of a scan: every third degree.
const POINTS_OF: usize = 3;

/// One direction of a link over time.
#[derive(Clone, Debug)]
pub struct Lane {
    /// Link and direction, e.g. `lidar to-master`.
    pub name: String,
    /// Share of the line's time that was used, per bin.
    pub load: Vec<f64>,
    /// Characters without a stop bit, per bin.
    pub errors: Vec<u64>,
    /// Bytes that faults struck, per bin.
    pub faults: Vec<u64>,
    before: Traffic,
    struck_before: usize,
}

/// Samples in order of time; every second one is dropped when there are too many. Copies share
/// them, because the maps are the largest part of a checkpoint.
#[derive(Clone, Debug)]
pub struct Thinned<T> {
    /// Times and samples.
    pub samples: Vec<(Instant, Arc<T>)>,
    period: Duration,
    next: Instant,
    most: usize,
}

impl<T> Thinned<T> {
    fn new(period: Duration, most: usize) -> Self {
        Self {
            samples: Vec::new(),
            period,
            next: Instant::ZERO,
            most,
        }
    }

    /// Adds a sample from `make` if one is due at `now`.
    fn offer(&mut self, now: Instant, make: impl FnOnce() -> Option<T>) {
        if now < self.next {
            return;
        }
        if let Some(sample) = make() {
            self.take(now, sample);
        }
    }

    fn take(&mut self, now: Instant, sample: T) {
        self.samples.push((now, Arc::new(sample)));
        if self.samples.len() > self.most {
            let mut number = 0;
            self.samples.retain(|_| {
                number += 1;
                number % 2 == 1
            });
            self.period *= 2;
        }
        self.next = now + self.period;
    }

    /// As [`offer`](Self::offer), for data that changes rarely: a sample is added only if it
    /// differs from the last one.
    fn offer_change(&mut self, now: Instant, make: impl FnOnce() -> T)
    where
        T: PartialEq + Default,
    {
        if now < self.next {
            return;
        }
        self.next = now + self.period;
        let sample = make();
        let is_news = match self.samples.last() {
            Some((_, last)) => **last != sample,
            None => sample != T::default(),
        };
        if is_news {
            self.take(now, sample);
        }
    }
}

/// A scan from the program's view, in the map's frame: x and y of each point in turn, metres.
pub(crate) type Points = Vec<f64>;

/// The course of a run over time.
#[derive(Clone, Debug)]
pub struct History {
    /// Length of a bin of the lanes.
    pub bin: Duration,
    /// All directions of all links.
    pub lanes: Vec<Lane>,
    /// Scans.
    pub scans: Thinned<Points>,
    /// Maps.
    pub maps: Thinned<KeptMap>,
    /// Further data of the robot.
    pub overlays: Thinned<Vec<Overlay>>,
    next_bin: Instant,
    end: Instant,
}

impl History {
    /// The history of a run of `duration` that has not begun. A run that continues after its
    /// duration, as on the page, has no history after it.
    pub fn new(duration: Duration) -> Self {
        let bin = (duration / BINS_MAX).max(BIN_MIN);
        Self {
            bin,
            lanes: Vec::new(),
            scans: Thinned::new(Duration::from_secs(1), SCANS_MAX),
            maps: Thinned::new(Duration::from_secs(4), MAPS_MAX),
            overlays: Thinned::new(Duration::from_secs(1), OVERLAYS_MAX),
            next_bin: Instant::ZERO + bin,
            end: Instant::ZERO + duration,
        }
    }

    /// Checks the rig; called every few milliseconds of virtual time.
    pub fn observe(&mut self, rig: &Rig, instruments: &dyn Instruments) {
        let now = rig.now();
        if now > self.end {
            return;
        }
        if now >= self.next_bin {
            self.next_bin = now + self.bin;
            self.count(rig);
        }
        self.scans.offer(now, || {
            instruments.estimate(rig)?;
            let points = instruments.scan(rig).into_iter().step_by(POINTS_OF);
            Some(points.flatten().collect())
        });
        self.maps.offer(now, || {
            instruments.estimate(rig)?;
            instruments.map(rig).map(KeptMap::from)
        });
        self.overlays
            .offer_change(now, || instruments.overlays(rig));
    }

    fn count(&mut self, rig: &Rig) {
        if self.lanes.is_empty() {
            self.lanes = rig.links().iter().flat_map(lanes_of).collect();
        }
        let lines = rig.links().iter().flat_map(|link| &link.lines);
        for (lane, line) in self.lanes.iter_mut().zip(lines) {
            let (traffic, struck) = (line.traffic(), line.faults.struck_len());
            let [sender, _] = rig.line_configs(line);
            let busy = sender.bytes_time(traffic.sent - lane.before.sent);
            let load = busy.as_secs_f64() / self.bin.as_secs_f64();
            lane.load.push((load * 1000.0).round() / 1000.0);
            let errors = traffic.framing_errors - lane.before.framing_errors;
            lane.errors.push(errors);
            lane.faults
                .push(struck.saturating_sub(lane.struck_before) as u64);
            (lane.before, lane.struck_before) = (traffic, struck);
        }
    }
}

fn lanes_of(link: &Link) -> impl Iterator<Item = Lane> + use<> {
    let directions = [Direction::ToMaster, Direction::ToDevice];
    let names = directions.map(|direction| format!("{} {}", link.name, direction.name()));
    names.into_iter().map(|name| Lane {
        name,
        load: Vec::new(),
        errors: Vec::new(),
        faults: Vec::new(),
        before: Traffic::default(),
        struck_before: 0,
    })
}

#[cfg(test)]
mod tests {
    use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
    use protocols::{LineConfig, Port};

    use super::*;
    use crate::rig::fault::{Damage, Strike};
    use crate::rig::line::End;

    /// Unchanged data is sampled once; missing data is not sampled.
    #[test]
    fn what_seldom_changes_is_sampled_when_it_does() {
        let mut thinned = Thinned::new(Duration::from_secs(1), 5);
        for (second, value) in (0..).zip(["", "", "a", "a", "a", "b", ""]) {
            thinned.offer_change(Instant::from_secs(second), || value);
        }
        let kept: Vec<_> = thinned.samples.iter().map(|(_, value)| **value).collect();
        assert_eq!(kept, ["a", "b", ""]);
    }

    /// Five samples at most: the sixth drops every second one and doubles the period.
    #[test]
    fn a_long_run_is_sampled_more_coarsely() {
        let mut thinned = Thinned::new(Duration::from_secs(1), 5);
        for second in 0..10 {
            thinned.offer(Instant::from_secs(second), || Some(second));
        }
        let kept: Vec<u64> = thinned.samples.iter().map(|(_, second)| **second).collect();
        assert_eq!(kept, [0, 2, 4, 7, 9]);
    }

    /// `make` is called only when a sample is due; if it returns none, it is called again later.
    #[test]
    fn a_sample_is_made_when_it_is_due_and_not_before() {
        let mut thinned = Thinned::new(Duration::from_secs(1), 5);
        let mut asked = Vec::new();
        for millis in [0, 400, 999, 1000, 1400, 2000, 3100, 4000, 4100] {
            thinned.offer(Instant::from_millis(millis), || {
                asked.push(millis);
                (millis != 1000).then_some(())
            });
        }
        assert_eq!(asked, [0, 1000, 1400, 3100, 4100]);
        let mut changes = Thinned::new(Duration::from_secs(1), 5);
        let mut asked = Vec::new();
        for millis in [0, 500, 1000, 1500, 2000] {
            changes.offer_change(Instant::from_millis(millis), || {
                asked.push(millis);
                millis
            });
        }
        assert_eq!(asked, [0, 1000, 2000]);
        assert_eq!(changes.samples.len(), 2);
    }

    /// 500 bins at most, of 100 ms at least.
    #[test]
    fn a_bin_is_a_five_hundredth_of_the_run_and_no_shorter_than_100_ms() {
        let bin = |secs| History::new(Duration::from_secs(secs)).bin.as_millis();
        assert_eq!([5, 50, 100].map(bin), [100, 100, 200]);
    }

    /// 50 bytes of 10 bits at 10000 baud take 50 ms, half of a bin. One of them is damaged. The
    /// second bin has no bytes. In the third one the receiver reads at twice the rate: it sees no
    /// stop bit of 0x00.
    #[test]
    fn a_lane_tells_of_each_bin_by_itself() {
        let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("empty");
        let body = BodyConfig::default().ideal();
        let world = World::new(scene, body, Pose::default(), 1);
        let mut rig = Rig::new(world.expect("free"));
        let ends = ["left", "right"].map(|name| End {
            node: rig.add_outside(name, LineConfig::new_8n1(10_000)),
            port: Port(0),
        });
        let [left, right] = ends.map(|end| end.node);
        rig.connect("link", ends[0], ends[1], 1);
        let damage = Damage::Flip { bit: 0 };
        let faults = &mut rig.line_mut(0, Direction::ToMaster).faults;
        faults.add_strike(Strike { byte: 7, damage });
        let mut history = History::new(Duration::from_secs(1));
        let mut bin = |rig: &mut Rig, until: u64, bytes: &[u8]| {
            rig.inject(left, bytes);
            rig.run_until(Instant::from_millis(until));
            history.count(rig);
        };
        bin(&mut rig, 100, &[0x55; 50]);
        bin(&mut rig, 200, &[]);
        rig.set_line_config(right, LineConfig::new_8n1(20_000));
        bin(&mut rig, 300, &[0; 10]);
        bin(&mut rig, 400, &[]);
        let names: Vec<_> = history.lanes.iter().map(|lane| &lane.name).collect();
        assert_eq!(names, ["link to-master", "link to-device"]);
        let lane = &history.lanes[0];
        assert_eq!(lane.load, [0.5, 0.0, 0.1, 0.0]);
        assert_eq!(lane.faults, [1, 0, 0, 0]);
        assert_eq!(lane.errors[..2], [0, 0]);
        assert!(
            lane.errors[2] > 0 && lane.errors[3] == 0,
            "{:?}",
            lane.errors
        );
        assert_eq!(history.lanes[1].load, [0.0; 4]);
    }

    /// A robot with an estimate, whose scan is these points.
    struct Robot;

    impl Instruments for Robot {
        fn estimate(&self, rig: &Rig) -> Option<(Instant, Pose)> {
            (rig.now() >= Instant::from_millis(500)).then(|| (rig.now(), Pose::default()))
        }

        fn scan(&self, _: &Rig) -> Vec<[f64; 2]> {
            (0..7_u8).map(|at| [f64::from(at), 0.5]).collect()
        }
    }

    /// Bins of 100 ms; scans each second from the first estimate on, every third point of them.
    /// Nothing is sampled after the end.
    #[test]
    fn a_run_is_sampled_until_its_end() {
        let mut rig = crate::rig::bare::rig();
        let ends = ["left", "right"].map(|name| End {
            node: rig.add_outside(name, LineConfig::new_8n1(10_000)),
            port: Port(0),
        });
        rig.connect("link", ends[0], ends[1], 1);
        let mut history = History::new(Duration::from_secs(3));
        for millis in (10..=3_500).step_by(10) {
            rig.run_until(Instant::from_millis(millis));
            history.observe(&rig, &Robot);
        }
        assert_eq!(history.lanes.len(), 2);
        assert_eq!(history.lanes[0].load.len(), 30);
        let scans = history.scans.samples.iter();
        let times: Vec<u64> = scans.map(|(at, _)| at.as_millis()).collect();
        assert_eq!(times, [500, 1_500, 2_500]);
        let points = &*history.scans.samples[0].1;
        assert_eq!(points, &[0.0, 0.5, 3.0, 0.5, 6.0, 0.5]);
        assert!(history.maps.samples.is_empty() && history.overlays.samples.is_empty());
        let mut short = History::new(Duration::from_millis(250));
        rig = crate::rig::bare::rig();
        for millis in [99, 100, 199, 200, 249, 250, 300] {
            rig.run_until(Instant::from_millis(millis));
            short.observe(&rig, &Robot);
        }
        assert_eq!(short.next_bin, Instant::from_millis(300));
    }
}
