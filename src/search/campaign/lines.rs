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
