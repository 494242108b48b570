//! List of the faults of a run: one row per fault; one row with a count for the hits of a rate.

use std::collections::BTreeMap;

use super::text::with_jumps;
use super::{row, section, table};
use crate::html::escape;
use engine::rig::line::Direction;
use engine::scenario::{FaultSpec, Span};

/// Maximum number of rows; case.toml has all faults.
const ROWS_MAX: usize = 100;
/// Maximum number of hits that are listed by their byte numbers.
const HITS_MAX: usize = 40;

/// Hits of one kind on one direction of a link, by their byte numbers.
type Hits<'a> = BTreeMap<(&'static str, String, &'static str), Vec<u64>>;

/// The section of all `faults`; empty if there are none.
pub(super) fn list(faults: &[FaultSpec]) -> String {
    if faults.is_empty() {
        return String::new();
    }
    let (mut hits, mut others) = (Hits::new(), Vec::new());
    for fault in faults {
        match fault.byte {
            Some(byte) => hits.entry(place(fault)).or_default().push(byte),
            None => others.push(fault),
        }
    }
    let hit = hits.iter().map(|((kind, link, way), bytes)| {
        let bytes = struck(bytes);
        row("", &[kind, &escape(link), way, &bytes])
    });
    let planned = others.into_iter().map(|fault| {
        let (kind, link, way) = place(fault);
        row("", &[kind, &escape(&link), way, &when(fault)])
    });
    let rows: Vec<String> = planned.chain(hit).collect();
    let all = rows.len();
    let more = super::more(all, all.min(ROWS_MAX), "case.toml");
    let rows = rows.into_iter().take(ROWS_MAX);
    section("faults", "Faults", &(table("faults", rows) + &more))
}

/// Kind, link or device, and direction.
fn place(fault: &FaultSpec) -> (&'static str, String, &'static str) {
    let way = match fault.direction.map(Direction::from) {
        Some(direction) => direction.name(),
        None => "",
    };
    (fault.kind.name(), fault.place(), way)
}

/// Rate and times.
fn when(fault: &FaultSpec) -> String {
    let rate = fault.rate.map(|rate| format!("rate {rate}"));
    let seconds = |span: Span| with_jumps(&format!("{:.6} s", span.0.as_secs_f64()));
    let from = fault.from.map(|span| format!("from {}", seconds(span)));
    let until = fault.until.map(|span| format!("until {}", seconds(span)));
    let words: Vec<String> = [rate, from, until].into_iter().flatten().collect();
    words.join(" ")
}

/// Number of damaged bytes, with their numbers in a folded list.
fn struck(bytes: &[u64]) -> String {
    if let [byte] = bytes {
        return format!("1 hit, byte {byte}");
    }
    let shown: Vec<String> = bytes.iter().take(HITS_MAX).map(u64::to_string).collect();
    let more = match bytes.len() - shown.len() {
        0 => String::new(),
        more => format!(" and {more} more; case.toml has all of them"),
    };
    let (count, shown) = (bytes.len(), shown.join(", "));
    format!("<details><summary>{count} hits</summary>bytes {shown}{more}</details>")
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::scenario::FaultKind;

    fn hit(kind: FaultKind, byte: u64) -> FaultSpec {
        FaultSpec {
            link: Some("lidar".to_owned()),
            byte: Some(byte),
            ..FaultSpec::new(kind)
        }
    }

    /// 600 flips and one drop make two rows; the byte numbers of 40 hits are listed.
    #[test]
    fn hits_of_one_kind_are_one_row_with_their_count() {
        let mut faults: Vec<FaultSpec> = (0..600).map(|byte| hit(FaultKind::Flip, byte)).collect();
        faults.push(hit(FaultKind::Drop, 7));
        let html = list(&faults);
        assert_eq!(html.matches("<tr").count(), 2);
        assert!(
            html.contains("<summary>600 hits</summary>bytes 0, 1, 2,"),
            "{html}"
        );
        assert!(
            html.contains(" 39 and 560 more; case.toml has all of them"),
            "{html}"
        );
        assert!(html.contains("<td>drop</td><td>lidar</td><td></td><td>1 hit, byte 7</td>"));
        assert_eq!(list(&[]), "");
    }
}
