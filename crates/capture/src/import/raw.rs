//! Import of bytes without times: assumed to be back to back at the line's rate.

use super::imported::{ImportError, Imported, Options, Untimed};
use super::text::{lines, number, utf8};

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let first = lines(bytes).next();
    if let Some(line) = first.filter(|line| is_stamped(line.text)) {
        let message = "tio wrote times between the bytes: expected its log without -t";
        return Err(line.wrong(message));
    }
    Untimed::new(options, out).stream(options.direction, bytes, out);
    Ok(())
}

/// Whether a line begins with a time of tio -t, `[08:00:04.460] `.
pub(super) fn is_stamped(text: &[u8]) -> bool {
    let text = text.get(..15).map(utf8).unwrap_or_default();
    let stamp = text
        .strip_prefix('[')
        .and_then(|text| text.strip_suffix("] "));
    let mut parts = stamp.unwrap_or_default().split([':', '.']);
    [2, 2, 2, 3].iter().all(|&len| {
        let part = parts.next().unwrap_or_default();
        part.len() == len && number(part).is_some()
    })
}
