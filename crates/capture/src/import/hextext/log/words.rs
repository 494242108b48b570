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
    // What a slave sends is received, and the other way round.
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
