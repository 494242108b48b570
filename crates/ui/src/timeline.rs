//! The record of a run, for going back in time: poses of the robot, traffic, figures for plots,
//! events, and occasionally the complete state of the page. Its size is limited: a longer run has a
//! coarser record.

use core::time::Duration;
use std::sync::Arc;

use protocols::Instant;
use serde_json::json;

use super::figures::{Figure, Series};
use super::snapshot::Snapshot;
use super::wire::Tally;
use engine::rig::Logged;

/// Maximum number of samples; when it is reached, every second one is dropped.
const SAMPLES_MAX: usize = 3000;
/// Maximum number of moments; when it is reached, every second one is dropped.
const MOMENTS_MAX: usize = 400;
/// Maximum number of recorded figures.
const SERIES_MAX: usize = 400;
/// Maximum number of events in one message to a page.
const EVENTS_AT_ONCE: usize = 200;
/// Maximum length of an event's text, bytes.
const DETAIL_MAX: usize = 300;

/// The record.
#[derive(Debug)]
pub(super) struct Timeline {
    /// Number of times that samples were dropped or the run was restarted: a page with another
    /// generation gets all samples again.
    pub(super) generation: u64,
    samples: Vec<String>,
    sample_times: Vec<Instant>,
    period: Duration,
    events: Vec<String>,
    moments: Vec<(Instant, Arc<Snapshot>)>,
    moments_period: Duration,
    series: Vec<Series>,
}

/// One sample.
#[derive(Debug)]
pub(super) struct Sample<'a> {
    pub(super) at: Instant,
    pub(super) truth: Option<[f64; 3]>,
    pub(super) believed: Option<[f64; 3]>,
    pub(super) tallies: &'a [[Tally; 2]],
    pub(super) figures: &'a [Figure],
}

impl Default for Timeline {
    fn default() -> Self {
        Self::new(0)
    }
}

impl Timeline {
    /// An empty record.
    pub(super) const fn new(generation: u64) -> Self {
        Self {
            generation,
            samples: Vec::new(),
            sample_times: Vec::new(),
            period: Duration::from_millis(200),
            events: Vec::new(),
            moments: Vec::new(),
            moments_period: Duration::from_millis(500),
            series: Vec::new(),
        }
    }

    /// Whether a sample is due.
    pub(super) fn wants_sample(&self, now: Instant) -> bool {
        let last = self.sample_times.last();
        last.is_none_or(|&last| now - last >= self.period)
    }

    /// Whether a moment is due.
    pub(super) fn wants_moment(&self, now: Instant) -> bool {
        let last = self.moments.last();
        last.is_none_or(|(last, _)| now - *last >= self.moments_period)
    }

    /// Adds a sample.
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
        let figures = self.values(sample.figures);
        let (at, truth, believed) = (sample.at.as_millis(), sample.truth, sample.believed);
        self.samples
            .push(json!([at, truth, believed, lanes, figures]).to_string());
        self.sample_times.push(sample.at);
    }

    /// The figures in the order of the series; new series are appended.
    fn values(&mut self, figures: &[Figure]) -> Vec<Option<f64>> {
        let mut values = vec![None; self.series.len()];
        for (index, figure) in figures.iter().enumerate() {
            // Usually the series are the same as before.
            let is_same = self.series.get(index) == Some(&figure.series);
            let mut all = self.series.iter();
            let known = match is_same {
                true => Some(index),
                false => all.position(|series| *series == figure.series),
            };
            let place = known.unwrap_or(self.series.len());
            if known.is_none() && place < SERIES_MAX {
                self.series.push(figure.series.clone());
                values.push(None);
            }
            if let Some(value) = values.get_mut(place) {
                *value = Some(figure.value);
            }
        }
        values
    }

    /// Adds the complete state of the page at `now`.
    pub(super) fn moment(&mut self, now: Instant, snapshot: Snapshot) {
        if self.moments.len() >= MOMENTS_MAX {
            halve(&mut self.moments);
            self.moments_period *= 2;
        }
        self.moments.push((now, Arc::new(snapshot)));
    }

    /// Removes everything after `until`, and all but the first `events` events: the run branches
    /// there.
    pub(super) fn cut(&mut self, until: Instant, events: usize) {
        let kept = self.sample_times.partition_point(|&at| at <= until);
        self.sample_times.truncate(kept);
        self.samples.truncate(kept);
        let kept = self.moments.partition_point(|(at, _)| *at <= until);
        self.moments.truncate(kept);
        self.events.truncate(events);
        self.generation += 1;
    }

    /// Adds an event.
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

    /// The latest moment not after `at`.
    pub(super) fn moment_at(&self, at: Instant) -> Option<Arc<Snapshot>> {
        let after = self.moments.partition_point(|(time, _)| *time <= at);
        let (_, snapshot) = self.moments.get(after.saturating_sub(1))?;
        Some(Arc::clone(snapshot))
    }

    /// All series as a message, if there are more than `seen`.
    pub(super) fn series_since(&self, seen: usize) -> Option<(String, usize)> {
        let count = self.series.len();
        let message = || json!({"type": "series", "series": self.series}).to_string();
        (count > seen).then(|| (message(), count))
    }

    /// The samples from index `from` on, as a message; `None` if there are none.
    pub(super) fn samples_since(&self, from: usize) -> Option<(String, usize)> {
        let new = self.samples.get(from..).filter(|new| !new.is_empty())?;
        let text = format!(
            r#"{{"type":"samples","from":{from},"samples":[{}]}}"#,
            new.join(",")
        );
        Some((text, self.samples.len()))
    }

    /// Some of the events from index `from` on, as a message; `None` if there are none.
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

/// Drops every second element, but keeps the last one.
fn halve<T>(list: &mut Vec<T>) {
    let mut index = list.len();
    list.retain(|_| {
        index -= 1;
        index.is_multiple_of(2)
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two hours at 200 ms would be 36,000 samples: the record never has more than 3000, covers the
    /// whole time, and always contains the newest sample.
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
                    figures: &[],
                };
                timeline.sample(&sample);
                assert_eq!(timeline.sample_times.last(), Some(&at));
            }
            if timeline.wants_moment(at) {
                timeline.moment(at, Snapshot::default());
            }
        }
        assert!((1500..=SAMPLES_MAX).contains(&timeline.samples.len()));
        assert!((MOMENTS_MAX / 2..=MOMENTS_MAX).contains(&timeline.moments.len()));
        let gaps = timeline.sample_times.windows(2);
        let longest = gaps.map(|gap| gap[1] - gap[0]).max();
        assert!(longest <= Some(Duration::from_secs(7)), "{longest:?}");
    }

    /// A new figure gets a new column; a missing figure leaves a gap.
    #[test]
    fn figures_keep_their_columns() {
        let mut timeline = Timeline::new(0);
        let figure = |name: &str, value: f64| Figure {
            series: Series::new("axis", name, "mm"),
            value,
        };
        let rows = [
            vec![figure("a", 1.0)],
            vec![figure("b", 2.0), figure("a", 3.0)],
            vec![figure("b", 4.0)],
        ];
        let values: Vec<_> = rows.iter().map(|row| timeline.values(row)).collect();
        let expected = [
            vec![Some(1.0)],
            vec![Some(3.0), Some(2.0)],
            vec![None, Some(4.0)],
        ];
        assert_eq!(values, expected);
        assert_eq!(timeline.series_since(1).expect("one more").1, 2);
        assert_eq!(timeline.series_since(2), None);
    }

    /// A run that branches at 2 s has no later samples, moments and events.
    #[test]
    fn what_came_after_a_branch_is_forgotten() {
        let mut timeline = Timeline::new(0);
        for second in 0..5 {
            let at = Instant::from_secs(second);
            let (truth, believed, tallies, figures) = (None, None, &[][..], &[][..]);
            timeline.sample(&Sample {
                at,
                truth,
                believed,
                tallies,
                figures,
            });
            timeline.moment(at, Snapshot::default());
            timeline.events.push(second.to_string());
        }
        timeline.cut(Instant::from_secs(2), 1);
        let counts = (
            timeline.samples.len(),
            timeline.moments.len(),
            timeline.events.len(),
        );
        assert_eq!((counts, timeline.generation), ((3, 3, 1), 1));
    }
}
