//! Words of logs that say whether bytes were sent or received.

/// Words for sent bytes, and for received ones.
const SENT: [&str; 16] = [
    "tx",
    "txd",
    "send",
    "sent",
    "sending",
    "write",
    "writes",
    "wrote",
    "writing",
    "written",
    "request",
    "query",
    "transmit",
    "transmitted",
    "outgoing",
    "output",
];
const RECEIVED: [&str; 18] = [
    "got",
    "rx",
    "rxd",
    "recv",
    "receive",
    "received",
    "receiving",
    "rcv",
    "rcvd",
    "read",
    "reads",
    "reading",
    "response",
    "reply",
    "answer",
    "incoming",
    "input",
    "recvd",
];
/// Whether a word says that the bytes were sent; `None` if it says nothing.
pub(super) fn direction(word: &str) -> Option<bool> {
    let plain = word.trim_end_matches(|c: char| c.is_ascii_digit());
    let ends = |ends: &[&str]| ends.iter().any(|end| plain.ends_with(end));
    if SENT.contains(&plain) || ends(&["sent", "send"]) {
        return Some(true);
    }
    (RECEIVED.contains(&plain) || ends(&["received", "recv"])).then_some(false)
}

/// Whether the last word of a direction says that the host sent the bytes.
pub(super) fn told_by(words: &[String]) -> Option<bool> {
    let at = words.iter().rposition(|word| direction(word).is_some())?;
    // Bytes that a slave sends are received by the host, and the other way round.
    let is_of_slave = at > 0 && is_slave(&words[at - 1]) && !is_action_of_host(&words[at]);
    direction(&words[at]).map(|is_sent| is_sent != is_of_slave)
}

/// Whether a word names the end that replies, whose own view of a direction is the opposite.
fn is_slave(word: &str) -> bool {
    let plain = word.trim_end_matches(|c: char| c.is_ascii_digit());
    matches!(plain, "slave" | "server")
}

/// Whether a word tells what the host does with a slave: "slave read", "server request".
fn is_action_of_host(word: &str) -> bool {
    [
        "read", "writ", "wrote", "request", "query", "response", "reply", "answer",
    ]
    .iter()
    .any(|action| word.starts_with(action))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_say_a_direction() {
        for word in SENT.iter().chain(&["tx1", "bytessent", "presend"]) {
            assert_eq!(direction(word), Some(true), "{word}");
        }
        for word in RECEIVED.iter().chain(&["rx2", "justreceived", "xrecv"]) {
            assert_eq!(direction(word), Some(false), "{word}");
        }
        assert_eq!(direction("port"), None);
    }

    /// The host receives the bytes that a slave sends, and those that it reads from a slave.
    #[test]
    fn the_last_word_and_the_end_it_belongs_to_count() {
        let told = |text: &str| {
            let words: Vec<String> = text.split(' ').map(str::to_owned).collect();
            told_by(&words)
        };
        for (text, expected) in [
            ("tx then rx", Some(false)),
            ("rx then tx", Some(true)),
            ("slave sent", Some(false)),
            ("slave2 recv", Some(true)),
            ("server tx", Some(false)),
            ("slave read", Some(false)),
            ("server writes", Some(true)),
            ("slave request", Some(true)),
            ("server reply", Some(false)),
            ("sent slave", Some(true)),
            ("a port", None),
        ] {
            assert_eq!(told(text), expected, "{text}");
        }
    }
}
