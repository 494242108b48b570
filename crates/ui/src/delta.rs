//! The data that a page has received, and the data to be sent next. No I/O: values in, messages
//! out.

use axum::extract::ws::Utf8Bytes;
use bytes::Bytes;

use super::map_layers::Layer;
use super::snapshot::Snapshot;
use super::timeline::Timeline;

/// A message to a page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Message {
    /// JSON; pages share the text of common messages.
    Text(Utf8Bytes),
    /// Rows of maps.
    Rows(Bytes),
}

/// The data that one page has received.
#[derive(Clone, Debug, Default)]
pub(super) struct SentSoFar {
    run: Option<u64>,
    generation: u64,
    samples: usize,
    events: usize,
    slow: Option<u64>,
    scan: Option<u64>,
    overlays: Option<u64>,
    checks: Option<u64>,
    series: usize,
    rows: Vec<u64>,
}

impl SentSoFar {
    /// The new data in `snapshot` and `timeline`. The snapshot itself comes last, so that a page
    /// that shows a time has all data of that time.
    pub(super) fn news(&mut self, snapshot: &Snapshot, timeline: &Timeline) -> Vec<Message> {
        let mut news = Vec::new();
        if self.run != Some(snapshot.run) {
            *self = Self {
                run: Some(snapshot.run),
                generation: timeline.generation,
                ..Self::default()
            };
            news.push(Message::Text(snapshot.stage.clone()));
        }
        if self.generation != timeline.generation {
            self.generation = timeline.generation;
            self.samples = 0;
        }
        if let Some((text, series)) = timeline.series_since(self.series) {
            self.series = series;
            news.push(Message::Text(text.into()));
        }
        if let Some((text, samples)) = timeline.samples_since(self.samples) {
            self.samples = samples;
            news.push(Message::Text(text.into()));
        }
        while let Some((text, events)) = timeline.events_since(self.events) {
            self.events = events;
            news.push(Message::Text(text.into()));
        }
        let numbered = [
            (&mut self.slow, &snapshot.slow),
            (&mut self.scan, &snapshot.scan),
            (&mut self.overlays, &snapshot.overlays),
            (&mut self.checks, &snapshot.checks),
        ];
        for (seen, newest) in numbered {
            if *seen != Some(newest.number) && newest.number > 0 {
                *seen = Some(newest.number);
                news.push(Message::Text(newest.text.clone()));
            }
        }
        let rows = self.rows_of(snapshot);
        if !rows.is_empty() {
            news.push(Message::Rows(rows.into()));
        }
        news.push(Message::Text(snapshot.fast.clone()));
        news
    }

    fn rows_of(&mut self, snapshot: &Snapshot) -> Vec<u8> {
        self.rows.resize(snapshot.layers.len(), 0);
        let mut rows = Vec::new();
        for ((index, layer), seen) in (0..).zip(&snapshot.layers).zip(&mut self.rows) {
            *seen = Layer::write_since(layer, *seen, index, &mut rows);
        }
        rows
    }
}

#[cfg(test)]
mod tests {

    use super::super::map_layers::MapLayer;
    use super::super::snapshot::Numbered;
    use super::*;

    fn snapshot(run: u64, scan: u64, book: &MapLayer) -> Snapshot {
        Snapshot {
            run,
            stage: "stage".into(),
            fast: "fast".into(),
            slow: Numbered::new("never"),
            scan: Numbered {
                number: scan,
                text: "scan".into(),
            },
            overlays: Numbered::new("never"),
            checks: Numbered::new("never"),
            layers: vec![book.last()],
        }
    }

    fn kinds(messages: &[Message]) -> Vec<&str> {
        let kind = |message: &Message| match message {
            Message::Text(text) => match &text[..4] {
                "stag" => "stage",
                "scan" => "scan",
                _ => "fast",
            },
            Message::Rows(_) => "rows",
        };
        messages.iter().map(kind).collect()
    }

    /// A page that missed snapshots gets the new data of the latest one, once; a page of another
    /// run starts from the beginning.
    #[test]
    fn a_page_gets_what_it_has_not_seen() {
        let (mut seen, timeline) = (SentSoFar::default(), Timeline::default());
        let mut book = MapLayer::new("map");
        book.look([2, 1], 0.01, [0.0; 2], |_| Some(&[1, 2]));
        let news = seen.news(&snapshot(1, 1, &book), &timeline);
        assert_eq!(kinds(&news), ["stage", "scan", "rows", "fast"]);
        let news = seen.news(&snapshot(1, 1, &book), &timeline);
        assert_eq!(kinds(&news), ["fast"]);
        book.look([2, 1], 0.01, [0.0; 2], |_| Some(&[1, 3]));
        let news = seen.news(&snapshot(1, 7, &book), &timeline);
        assert_eq!(kinds(&news), ["scan", "rows", "fast"]);
        let news = seen.news(&snapshot(2, 0, &book), &timeline);
        assert_eq!(kinds(&news), ["stage", "rows", "fast"]);
    }
}
