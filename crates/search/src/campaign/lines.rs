//! The file of finished runs: one JSON object per line, append-only.
//!
//! A kill can truncate the last line; a line with its line end is complete.

use std::borrow::Cow;
use std::io::{self, BufRead};

use serde::{Deserialize, Serialize};

use super::{Record, Run};

/// The first bytes of every line.
const START: &[u8] = b"{\"scenario\":\"";

/// The result of one run as written in the file. Text without escapes is not copied.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Line<'a> {
    #[serde(borrow)]
    pub scenario: Cow<'a, str>,
    pub seed: u64,
    #[serde(borrow)]
    cause: Option<Word<'a>>,
    #[serde(borrow)]
    detail: Option<Word<'a>>,
    pub ran_ms: u64,
    #[serde(borrow)]
    pub trace: Cow<'a, str>,
    #[serde(borrow)]
    reached: Vec<Word<'a>>,
}

/// A nested text, in the form that serde can borrow.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Word<'a>(#[serde(borrow)] Cow<'a, str>);

impl<'a> Word<'a> {
    fn of(text: &'a str) -> Self {
        Self(Cow::Borrowed(text))
    }
}

impl<'a> Line<'a> {
    /// The line of a run that has just ended.
    pub(super) fn of(record: &'a Record) -> Self {
        Self {
            scenario: Cow::Borrowed(&record.scenario),
            seed: record.seed,
            cause: record.cause.as_deref().map(Word::of),
            detail: record.detail.as_deref().map(Word::of),
            ran_ms: record.ran_ms,
            trace: Cow::Borrowed(&record.trace),
            reached: record.reached.iter().map(|word| Word::of(word)).collect(),
        }
    }

    /// The line of a stored run.
    pub(super) fn of_kept(run: &'a Run<'_>) -> Self {
        Self {
            scenario: Cow::Borrowed(run.scenario),
            seed: run.seed,
            cause: run.cause.map(Word::of),
            detail: run.detail.map(Word::of),
            ran_ms: run.ran_ms,
            trace: run.trace(),
            reached: run.reached.iter().map(|word| Word::of(word)).collect(),
        }
    }

    /// The cause of the failure, without the figures.
    pub(super) fn cause(&self) -> Option<&str> {
        self.cause.as_ref().map(|word| &*word.0)
    }

    /// The cause of the failure, with the figures.
    pub(super) fn detail(&self) -> Option<&str> {
        self.detail.as_ref().map(|word| &*word.0)
    }

    /// Situations that occurred.
    pub(super) fn reached(&self) -> impl Iterator<Item = &str> {
        self.reached.iter().map(|word| &*word.0)
    }

    /// The bytes of the line.
    pub(super) fn text(&self) -> String {
        serde_json::to_string(self).expect("plain data") + "\n"
    }
}

/// The reason why a file is not a file of runs.
#[derive(Debug)]
pub(super) enum LinesError {
    /// The file cannot be read.
    Read(io::Error),
    /// The file has other content.
    Content(String),
}

/// Passes the runs in `file` to `take` one by one. Returns the number of bytes of complete lines; a
/// truncated line may follow.
///
/// # Errors
/// If a line is not a run, if `take` rejects it, or if the end is not a truncated line.
pub(super) fn read(
    mut file: impl BufRead,
    mut take: impl FnMut(&Line<'_>) -> Result<(), String>,
) -> Result<u64, LinesError> {
    let (mut whole, mut bytes) = (0, Vec::new());
    for number in 1.. {
        bytes.clear();
        file.read_until(b'\n', &mut bytes)
            .map_err(LinesError::Read)?;
        let wrong = |what: String| Err(LinesError::Content(format!("line {number}: {what}")));
        if bytes.last() != Some(&b'\n') {
            if !is_torn_line(&bytes) {
                return wrong("is no part of a run, expected runs".to_owned());
            }
            break;
        }
        let taken = match serde_json::from_slice(&bytes) {
            Ok(line) => take(&line),
            Err(error) => Err(unread(&error)),
        };
        if let Err(what) = taken {
            return wrong(what);
        }
        whole += bytes.len() as u64;
    }
    Ok(whole)
}

/// The message on a line that is no run, with the place in it and the fix.
fn unread(error: &serde_json::Error) -> String {
    let column = error.column();
    let words = error.to_string();
    // The reader counts lines from the start of this one.
    let words = words
        .rsplit_once(" at line ")
        .map_or(&*words, |(words, _)| words);
    format!(
        "column {column}: {words}, expected a run, as a JSON object; remove the line, \
         and the campaign repeats its run"
    )
}

/// Whether `bytes` are the beginning of a line. After a power cut some file systems fill the
/// missing part with zeros.
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
        /// A run with arbitrary texts, also with line ends.
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

    fn line(record: &Record) -> String {
        Line::of(record).text()
    }

    /// The texts of the runs in `bytes`, and their length.
    fn parse(bytes: &[u8]) -> Result<(Vec<String>, u64), String> {
        let mut lines = Vec::new();
        let whole = read(bytes, |line| {
            lines.push(line.text());
            Ok(())
        });
        match whole {
            Ok(whole) => Ok((lines, whole)),
            Err(LinesError::Content(message)) => Err(message),
            Err(LinesError::Read(error)) => Err(error.to_string()),
        }
    }

    proptest! {
        /// A kill truncates the file at any byte; a power cut may leave zeros behind that point.
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
            let whole: Vec<String> = whole.into_iter().map(line).collect();
            let whole_len = whole.concat().len() as u64;
            bytes.resize(bytes.len() + zeros, 0);

            let (read, len) = parse(&bytes).expect("what a kill leaves is no error");

            prop_assert_eq!(read, whole);
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

    /// A damaged line names its place, and what to do.
    #[test]
    fn a_damaged_line_names_its_place_and_the_fix() {
        let record = Record {
            scenario: "s".to_owned(),
            seed: 1,
            cause: None,
            detail: None,
            ran_ms: 5,
            trace: String::new(),
            reached: std::collections::BTreeSet::new(),
        };
        let damaged = line(&record).replace("\"seed\":1", "\"seed\":x");
        let error = parse(format!("{}{damaged}", line(&record)).as_bytes()).expect_err("damaged");
        assert_eq!(
            error,
            "line 2: column 24: expected value, expected a run, as a JSON object; remove the line, \
             and the campaign repeats its run"
        );
    }

    /// Only the truncated line of a campaign is removed: a foreign file without a final line end is
    /// rejected.
    #[test]
    fn the_end_of_another_file_is_not_cut_away() {
        let refused = |bytes: &[u8]| parse(bytes).is_err();
        assert!(refused(b"notes of today"));
        assert!(refused(b"{\"seed\":1"));
        assert!(!refused(b"{\"scena"));
        assert!(!refused(b""));
    }
}
