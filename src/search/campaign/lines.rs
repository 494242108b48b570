//! The file of finished runs: one JSON object a line, only ever appended to.
//!
//! A kill can leave the last line without its end; whatever has an end is whole.

use super::Record;

/// How every line begins.
const START: &[u8] = b"{\"scenario\":\"";

/// The line of `record`.
pub(super) fn line(record: &Record) -> String {
    serde_json::to_string(record).expect("plain data") + "\n"
}

/// The runs in `bytes`, and how many bytes their lines have: what follows is a torn line.
///
/// # Errors
/// If a line is not a run, or the end is not what a kill leaves of a line.
pub(super) fn parse(bytes: &[u8]) -> Result<(Vec<Record>, usize), String> {
    let end = bytes.iter().rposition(|&byte| byte == b'\n');
    let (lines, torn) = bytes.split_at(end.map_or(0, |at| at + 1));
    let mut records = Vec::new();
    for line in lines.split_inclusive(|&byte| byte == b'\n') {
        let record = serde_json::from_slice(line);
        let number = records.len() + 1;
        records.push(record.map_err(|error| format!("line {number}: {error}, expected a run"))?);
    }
    if !is_torn_line(torn) {
        let number = records.len() + 1;
        return Err(format!("line {number}: is no part of a run, expected runs"));
    }
    Ok((records, lines.len()))
}

/// Whether `bytes` are the beginning of a line. After a power cut some file systems have zeros in
/// place of what was not written yet.
fn is_torn_line(bytes: &[u8]) -> bool {
    let zeros = bytes.iter().rev().take_while(|&&byte| byte == 0).count();
    let written = &bytes[..bytes.len() - zeros];
    written.starts_with(START) || START.starts_with(written)
}

#[cfg(test)]
mod tests {
    use proptest::collection::{btree_set, vec};
    use proptest::prelude::*;

    use super::*;

    prop_compose! {
        /// A run with any text in its words, line ends among it.
        fn any_record()(
            scenario in "[a-z.-]{1,8}",
            seed: u64,
            words in proptest::option::of((any::<String>(), "[\n\"{}\u{e4}\0]{0,9}")),
            ran_ms: u64,
            trace in "[0-9a-f]{0,16}",
            reached in btree_set("[a-z ]{1,9}", 0..3),
        ) -> Record {
            let (cause, detail) = words.unzip();
            Record { scenario, seed, cause, detail, ran_ms, trace, reached }
        }
    }

    proptest! {
        /// A kill cuts the file anywhere, a power cut may leave zeros behind the cut.
        #[test]
        fn every_whole_line_before_a_cut_is_kept(
            records in vec(any_record(), 0..6),
            cut: prop::sample::Index,
            zeros in 0_usize..40,
        ) {
            let mut bytes = records.iter().map(line).collect::<String>().into_bytes();
            bytes.truncate(cut.index(bytes.len() + 1));
            let whole: Vec<&Record> = records
                .iter()
                .scan(0, |end, record| {
                    *end += line(record).len();
                    Some((*end, record))
                })
                .take_while(|(end, _)| *end <= bytes.len())
                .map(|(_, record)| record)
                .collect();
            let whole_len: usize = whole.iter().map(|record| line(record).len()).sum();
            bytes.resize(bytes.len() + zeros, 0);

            let (read, len) = parse(&bytes).expect("what a kill leaves is no error");

            prop_assert_eq!(read.iter().collect::<Vec<_>>(), whole);
            prop_assert_eq!(len, whole_len);
        }

        #[test]
        fn any_bytes_are_runs_or_refused_with_their_line(bytes in vec(any::<u8>(), 1..200)) {
            if let Err(message) = parse(&bytes) {
                prop_assert!(message.starts_with("line "), "{}", message);
                prop_assert!(message.contains("expected"), "{}", message);
            }
        }
    }

    /// What is cut away was begun by a campaign: a stranger's file without a line end is none.
    #[test]
    fn the_end_of_another_file_is_not_cut_away() {
        let refused = |bytes: &[u8]| parse(bytes).is_err();
        assert!(refused(b"notes of today"));
        assert!(refused(b"{\"seed\":1"));
        assert!(!refused(b"{\"scena"));
        assert!(!refused(b""));
    }
}
