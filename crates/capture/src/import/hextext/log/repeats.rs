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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::text::lines;

    /// The bytes 1 2 and 3 are received: a line without a direction that ends with them shows them
    /// again. Sent bytes end the received ones.
    #[test]
    fn received_bytes_that_are_shown_again_are_dropped() {
        let text = b"1\n2\n3\n4\n5\n6\n";
        let all: [(Option<bool>, &[u8]); 6] = [
            (Some(false), &[1, 2]),
            (Some(false), &[3]),
            (None, &[2, 3]),
            (None, &[1, 2]),
            (Some(true), &[9]),
            (None, &[3]),
        ];
        let messages = lines(text).zip(all);
        let message = |(line, (is_sent, bytes)): (_, (_, &[u8]))| {
            Message::new(line, None, is_sent, bytes.to_vec())
        };
        let mut messages: Vec<Message<'_>> = messages.map(message).collect();
        let note = drop(&mut messages).expect("one is dropped");
        assert!(note.ends_with(": 1, the first is line 3"), "{note}");
        let left: Vec<usize> = messages.iter().map(|one| one.line.number).collect();
        assert_eq!(left, [1, 2, 4, 5, 6]);
        assert_eq!(drop(&mut messages), None);
    }
}
