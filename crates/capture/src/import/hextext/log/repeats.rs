//! Lines of a log that show bytes a second time.

use crate::import::hextext::Message;

/// Drops messages without a direction that show the last received bytes again, as pymodbus does in
/// "Processing"; returns a note.
pub(super) fn drop(messages: &mut Vec<Message<'_>>) -> Option<String> {
    let (mut received, mut lines) = (Vec::new(), Vec::new());
    messages.retain(|one| {
        match one.is_sent {
            Some(true) => received.clear(),
            Some(false) => received.extend_from_slice(&one.bytes),
            None if received.ends_with(&one.bytes) => {
                lines.push(one.line.number);
                return false;
            }
            None => {}
        }
        true
    });
    let (first, count) = (lines.first()?, lines.len());
    Some(format!(
        "lines that show received bytes again are left out: {count}, the first is line {first}"
    ))
}
