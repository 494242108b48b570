//! What was recorded of a run, for the time slider: where the robot was, what the wires carried,
//! what happened, and the maps now and then. Bounded: the longer the run, the coarser.

use core::time::Duration;
use std::sync::Arc;

use protocols::Instant;
use serde_json::json;

use super::map_layers::Layer;
use super::wire::Tally;
use crate::rig::Logged;

/// Most samples; when they are reached, every second one is dropped.
const SAMPLES_MAX: usize = 3000;
/// Most maps kept, likewise.
const MAPS_MAX: usize = 48;
/// Most events of one message to a page.
const EVENTS_AT_ONCE: usize = 200;
/// Most bytes of an event that are told.
const DETAIL_MAX: usize = 300;

/// What was recorded.
#[derive(Debug)]
pub(super) struct Timeline {
    /// Counts how often samples were dropped or the run began anew: a page that has seen another
    /// generation gets all of them again.
    pub(super) generation: u64,
    samples: Vec<String>,
    sample_times: Vec<Instant>,
    period: Duration,
    events: Vec<String>,
    maps: Vec<(Instant, Vec<Arc<Layer>>)>,
    maps_period: Duration,
}

/// One line of the record.
#[derive(Debug)]
pub(super) struct Sample<'a> {
    pub(super) at: Instant,
    pub(super) truth: Option<[f64; 3]>,
    pub(super) believed: Option<[f64; 3]>,
    pub(super) tallies: &'a [[Tally; 2]],
}

impl Default for Timeline {
    fn default() -> Self {
        Self::new(0)
    }
}

impl Timeline {
    /// Nothing recorded yet.
    pub(super) const fn new(generation: u64) -> Self {
        Self {
            generation,
            samples: Vec::new(),
            sample_times: Vec::new(),
            period: Duration::from_millis(200),
            events: Vec::new(),
            maps: Vec::new(),
            maps_period: Duration::from_secs(2),
        }
    }

    /// Whether it is time for another sample.
    pub(super) fn wants_sample(&self, now: Instant) -> bool {
        let last = self.sample_times.last();
        last.is_none_or(|&last| now - last >= self.period)
    }

    /// Whether it is time for the maps again.
    pub(super) fn wants_maps(&self, now: Instant) -> bool {
        let last = self.maps.last();
        last.is_none_or(|(last, _)| now - *last >= self.maps_period)
    }

    /// Takes a sample.
    pub(super) fn sample(&mut self, sample: &Sample<'_>) {
        if self.samples.len() >= SAMPLES_MAX {
            halve(&mut self.samples);
            halve(&mut self.sample_times);
            self.period *= 2;
            self.generation += 1;
        }
        let lanes = sample.tallies.iter().flatten();
        let lanes: Vec<[u64; 4]> = lanes
            .map(|tally| [tally.bytes, tally.frames, tally.errors, tally.faults])
            .collect();
        let (at, truth, believed) = (sample.at.as_millis(), sample.truth, sample.believed);
        self.samples
            .push(json!([at, truth, believed, lanes]).to_string());
        self.sample_times.push(sample.at);
    }

    /// Takes the maps.
    pub(super) fn maps(&mut self, now: Instant, layers: Vec<Arc<Layer>>) {
        if self.maps.len() >= MAPS_MAX {
            halve(&mut self.maps);
            self.maps_period *= 2;
        }
        self.maps.push((now, layers));
    }

    /// Takes an event.
    pub(super) fn event(&mut self, logged: &Logged) {
        let event = &logged.event;
        let detail: String = event.detail.chars().take(DETAIL_MAX).collect();
        let value = json!({
            "at": event.at.as_secs_f64(),
            "source": logged.source,
            "rule": event.rule,
            "detail": detail,
            "violation": logged.is_violation(),
        });
        self.events.push(value.to_string());
    }

    /// The maps as they were at `at` at the latest, as one message of rows, and their time.
    pub(super) fn maps_at(&self, at: Instant) -> Option<(Instant, Vec<u8>)> {
        let after = self.maps.partition_point(|(time, _)| *time <= at);
        let (time, layers) = self.maps.get(after.saturating_sub(1))?;
        Some((*time, Layer::whole(layers)))
    }

    /// The samples from number `from` on, as a message; `None` if there are none.
    pub(super) fn samples_since(&self, from: usize) -> Option<(String, usize)> {
        let new = self.samples.get(from..).filter(|new| !new.is_empty())?;
        let text = format!(
            r#"{{"type":"samples","from":{from},"samples":[{}]}}"#,
            new.join(",")
        );
        Some((text, self.samples.len()))
    }

    /// Some of the events from number `from` on, as a message; `None` if there are none.
    pub(super) fn events_since(&self, from: usize) -> Option<(String, usize)> {
        let new = self.events.get(from..).filter(|new| !new.is_empty())?;
        let new = &new[..new.len().min(EVENTS_AT_ONCE)];
        let text = format!(
            r#"{{"type":"events","from":{from},"events":[{}]}}"#,
            new.join(",")
        );
        Some((text, from + new.len()))
    }
}

/// Drops every second one, the last one not.
fn halve<T>(list: &mut Vec<T>) {
    let mut index = list.len();
    list.retain(|_| {
        index -= 1;
        index.is_multiple_of(2)
    });
}

/// A number with as many digits as can be seen: millimetres, and about a twentieth of a degree.
pub(super) fn short_pose(pose: emulators::world::Pose) -> [f64; 3] {
    [pose.x, pose.y, pose.theta].map(crate::show::view::millimetres)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two hours at 200 ms would be 36,000 samples: the record never holds more than 3000, covers
    /// the whole time, and its newest sample is always there.
    #[test]
    fn the_record_gets_coarser_not_longer() {
        let mut timeline = Timeline::new(0);
        for seconds in (0..7200 * 5).map(|step| Duration::from_millis(200 * step)) {
            let at = Instant::ZERO + seconds;
            if timeline.wants_sample(at) {
                let sample = Sample {
                    at,
                    truth: None,
                    believed: None,
                    tallies: &[],
                };
                timeline.sample(&sample);
                assert_eq!(timeline.sample_times.last(), Some(&at));
            }
            if timeline.wants_maps(at) {
                timeline.maps(at, Vec::new());
            }
        }
        assert!((1500..=SAMPLES_MAX).contains(&timeline.samples.len()));
        assert!((24..=MAPS_MAX).contains(&timeline.maps.len()));
        let gaps = timeline.sample_times.windows(2);
        let longest = gaps.map(|gap| gap[1] - gap[0]).max();
        assert!(longest <= Some(Duration::from_secs(7)), "{longest:?}");
    }
}
