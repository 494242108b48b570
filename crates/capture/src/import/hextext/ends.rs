//! Names of both ends in a text: around an arrow, or as a label before the bytes.
//!
//! ```text
//! PC -> METER: 01 03 00       the sender and the receiver; also PC>METER, METER <- PC, PC to METER
//! METER -> PC: 01 03 04
//! master: 01 03 00            the sender alone
//! ```
//!
//! Common names have a known role. Of two unknown names, each of which sends to the other, the one
//! that sends first is the host.

use core::ops::Range;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use engine::hex;

/// Names of the end that polls, and names of the end that replies.
const HOSTS: [&str; 11] = [
    "host",
    "pc",
    "master",
    "client",
    "computer",
    "app",
    "application",
    "driver",
    "program",
    "software",
    "user",
];
const DEVICES: [&str; 14] = [
    "device",
    "slave",
    "server",
    "dut",
    "target",
    "peripheral",
    "sensor",
    "meter",
    "modem",
    "gps",
    "module",
    "instrument",
    "printer",
    "scale",
];
/// Names of the first list that are labels of bytes, too: others are also names of a log's parts.
const SENDERS: [&str; 4] = ["host", "pc", "master", "client"];
/// Labels of the bytes of each end.
const REQUESTS: [&str; 6] = ["request", "req", "query", "command", "cmd", "output"];
const REPLIES: [&str; 7] = ["response", "resp", "rsp", "reply", "answer", "ack", "input"];
/// Arrows, longer ones first, and whether they point to the right.
const ARROWS: [(&str, bool); 15] = [
    ("-->", true),
    ("<--", false),
    ("==>", true),
    ("<==", false),
    (">>>", true),
    ("<<<", false),
    ("->", true),
    ("<-", false),
    ("=>", true),
    (">>", true),
    ("<<", false),
    ("\u{2192}", true),
    ("\u{2190}", false),
    (">", true),
    ("<", false),
];
/// Words that say what happens to the bytes, and are no names.
const ACTIONS: [&str; 12] = [
    "tx", "rx", "send", "sent", "sending", "write", "wrote", "written", "read", "recv", "received",
    "receive",
];

/// Whether a name is that of the host; `None` if it has no known role.
fn role(name: &str) -> Option<bool> {
    let name = name.to_ascii_lowercase();
    let plain = name.trim_end_matches(|c: char| c.is_ascii_digit() || "_-#".contains(c));
    let is_in = |names: &[&str]| names.contains(&plain);
    match (is_in(&HOSTS), is_in(&DEVICES)) {
        (true, _) => Some(true),
        (_, true) => Some(false),
        _ => None,
    }
}

/// Whether a label before bytes says that the host sent them.
pub(super) fn label(word: &str) -> Option<bool> {
    let lower = word.to_ascii_lowercase();
    let is_in = |labels: &[&str]| labels.contains(&&*lower);
    role(word)
        .filter(|is_host| !is_host || is_in(&SENDERS))
        .or(is_in(&REQUESTS).then_some(true))
        .or(is_in(&REPLIES).then_some(false))
}

/// Two names around an arrow.
struct Pair<'a> {
    range: Range<usize>,
    left: &'a str,
    right: &'a str,
    is_right: bool,
}

impl<'a> Pair<'a> {
    /// The first pair of a text.
    fn of(text: &'a str) -> Option<Self> {
        let mut from = 0;
        while let Some((at, arrow, is_right)) = next_arrow(text, from) {
            let end = at + arrow.len();
            let (before, behind) = (&text[..at], &text[end..]);
            let left = before.trim_end();
            let is_name = |c: char| c.is_alphanumeric() || "_./#-".contains(c);
            let start = left.rfind(|c| !is_name(c)).map_or(0, |place| {
                place + left[place..].chars().next().map_or(1, char::len_utf8)
            });
            let right = behind.trim_start();
            let right = &right[..right.find(|c| !is_name(c)).unwrap_or(right.len())];
            let right = right.trim_end_matches(['-', '.', '/']);
            let (left, place) = (&left[start..], behind.len() - behind.trim_start().len());
            // A mark of one character is an arrow only between two blanks, or between two names.
            let is_even = before.ends_with(' ') == behind.starts_with(' ');
            if is_name_of_end(left) && is_name_of_end(right) && is_even {
                return Some(Self {
                    range: start..end + place + right.len(),
                    left,
                    right,
                    is_right,
                });
            }
            from = end;
        }
        None
    }

    /// The sender and the receiver.
    const fn ends(&self) -> (&'a str, &'a str) {
        match self.is_right {
            true => (self.left, self.right),
            false => (self.right, self.left),
        }
    }
}

/// The first arrow from `from` on: its place and direction.
fn next_arrow(text: &str, from: usize) -> Option<(usize, &'static str, bool)> {
    let arrow = text[from..].find(['<', '>', '-', '=', '\u{2192}', '\u{2190}']);
    let word = text[from..].find(" to ").map(|at| at + from);
    let mut at = from + arrow.unwrap_or(text.len() - from);
    while at < text.len() && word.is_none_or(|word| at < word) {
        let rest = &text[at..];
        if let Some((arrow, is_right)) = ARROWS.iter().find(|(arrow, _)| rest.starts_with(arrow)) {
            return Some((at, arrow, *is_right));
        }
        at += rest.chars().next().map_or(1, char::len_utf8);
    }
    word.map(|word| (word, " to ", true))
}

/// Whether a word may be the name of an end: it begins with a letter, and is neither bytes nor an
/// action.
fn is_name_of_end(word: &str) -> bool {
    let is_word = word.starts_with(|c: char| c.is_alphabetic() || c == '/');
    let lower = word.to_ascii_lowercase();
    is_word && !ACTIONS.contains(&&*lower) && hex::bytes(word).is_none()
}

/// The ends of all pairs of a file.
#[derive(Debug, Default)]
pub(in crate::import) struct Ends {
    /// Senders and receivers, and whether the sender is the host.
    known: BTreeMap<(String, String), bool>,
    /// Notes for the reader.
    pub(in crate::import) notes: Vec<String>,
}

impl Ends {
    /// The ends in `texts`.
    pub(in crate::import) fn of<'a>(texts: impl Iterator<Item = &'a str>) -> Self {
        let mut this = Self::default();
        let (mut written, mut order) = (BTreeSet::new(), Vec::new());
        for pair in texts.filter_map(Pair::of) {
            written.insert((pair.left, pair.right));
            let ends = pair.ends();
            if !order.contains(&ends) {
                order.push(ends);
            }
        }
        let peers = |name: &str| {
            order
                .iter()
                .filter(|pair| pair.0 == name || pair.1 == name)
                .count()
        };
        for &(sender, receiver) in &order {
            let of_roles = match (role(sender), role(receiver)) {
                (Some(one), Some(two)) if one == two => None,
                (Some(is_host), _) => Some(is_host),
                (None, other) => other.map(|is_host| !is_host),
            };
            // If only the arrow changes, the arrow gives the direction.
            let is_written = |pair: (&str, &str)| written.contains(&pair);
            let both = is_written((sender, receiver)) && is_written((receiver, sender));
            let is_host = of_roles.or_else(|| {
                let [own, other] = [sender, receiver].map(peers);
                let first = order.iter().position(|pair| *pair == (sender, receiver));
                let back = order.iter().position(|pair| *pair == (receiver, sender));
                let is_first = first < back;
                both.then_some(own > other || (own == other && is_first))
            });
            let Some(is_host) = is_host else { continue };
            if of_roles.is_none() && is_host {
                this.notes.push(format!(
                    "\"{sender}\" is taken as the host and \"{receiver}\" as the device, because \
                     \"{sender}\" sends first; --from program reverses the directions"
                ));
            }
            let ends = (sender.to_owned(), receiver.to_owned());
            this.known.insert(ends, is_host);
        }
        this
    }

    /// The text with TX or RX in place of two names around an arrow.
    pub(in crate::import) fn told<'a>(&self, text: &'a str) -> Cow<'a, str> {
        if self.known.is_empty() {
            return Cow::Borrowed(text);
        }
        let known = Pair::of(text).and_then(|pair| {
            let (sender, receiver) = pair.ends();
            let ends = (sender.to_owned(), receiver.to_owned());
            Some((pair.range, *self.known.get(&ends)?))
        });
        match known {
            Some((range, is_host)) => {
                let way = if is_host { "TX" } else { "RX" };
                Cow::Owned([&text[..range.start], way, &text[range.end..]].concat())
            }
            None => Cow::Borrowed(text),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(lines: &[&str]) -> Vec<String> {
        let ends = Ends::of(lines.iter().copied());
        lines
            .iter()
            .map(|line| ends.told(line).into_owned())
            .collect()
    }

    #[test]
    fn names_around_an_arrow_are_a_direction() {
        let both = ["TX: 01 03", "RX: 01 03"];
        for lines in [
            ["PC -> METER: 01 03", "METER -> PC: 01 03"],
            ["host->dev1: 01 03", "dev1->host: 01 03"],
            ["master --> slave: 01 03", "slave --> master: 01 03"],
            ["Client => Server: 01 03", "Server => Client: 01 03"],
            ["plc7 > drive_2: 01 03", "drive_2 > plc7: 01 03"],
            ["A \u{2192} B: 01 03", "B \u{2192} A: 01 03"],
            ["A <- B: 01 03", "B <- A: 01 03"],
            ["COM3 to scale: 01 03", "scale to COM3: 01 03"],
            ["meter << pc: 01 03", "meter >> pc: 01 03"],
        ] {
            assert_eq!(told(&lines), both, "{lines:?}");
        }
        let brackets = told(&["[PC -> METER] AB", "12:00:00.5 (METER -> PC) AB"]);
        assert_eq!(brackets, ["[TX] AB", "12:00:00.5 (RX) AB"]);
        // Of three ends, the one that speaks with both others is the host.
        let three = ["A -> B: 1", "C -> A: 2", "A -> C: 3", "B -> A: 4"];
        assert_eq!(told(&three), ["TX: 1", "RX: 2", "TX: 3", "RX: 4"]);
    }

    /// An arrow beside one name, between bytes or behind a time keeps its own meaning.
    #[test]
    fn other_arrows_stay() {
        for lines in [
            &["ttyS0 >> 10 5B", "ttyS0 << E5"][..],
            &["adapter: --> [01]", "adapter: <-- [02]"],
            &["12:11:23.5 -> 10 5B", "12:11:23.6 <- 10"],
            &["ttyS0 -> uart: 01", "ttyS0 <- uart: 02"],
            &["AB -> CD"],
            &["[RTU]>Tx > 12:11:23:456 - 01"],
            &["Will write to instrument: 01"],
            &["a-b=c"],
        ] {
            assert_eq!(told(lines), lines);
        }
    }

    #[test]
    fn a_label_is_the_sender() {
        for word in ["master", "Client", "HOST", "request", "cmd", "PC"] {
            assert_eq!(label(word), Some(true), "{word}");
        }
        assert_eq!(["app", "driver", "user"].map(label), [None; 3]);
        for word in ["slave", "Server", "device", "slave_3", "response", "ack"] {
            assert_eq!(label(word), Some(false), "{word}");
        }
        assert_eq!(["frame", "bytes", ""].map(label), [None; 3]);
    }
    #[test]
    fn arrows_and_the_word_to_are_found_in_their_order() {
        assert_eq!(next_arrow("a to b -> c", 0), Some((1, " to ", true)));
        assert_eq!(next_arrow("a -> b to c", 0), Some((2, "->", true)));
        assert_eq!(next_arrow("a -> b to c", 3), Some((3, ">", true)));
        assert_eq!(next_arrow("a <-- b", 0), Some((2, "<--", false)));
        assert_eq!(next_arrow("x-y = 3 to z", 0), Some((7, " to ", true)));
        assert_eq!((next_arrow("a-b = c", 0), next_arrow("", 0)), (None, None));
    }

    #[test]
    fn a_pair_is_two_names_around_an_arrow() {
        let pair = |text: &str| {
            Pair::of(text).map(|pair| {
                (
                    pair.left.to_owned(),
                    pair.right.to_owned(),
                    text[pair.range].to_owned(),
                )
            })
        };
        for (text, left, right, range) in [
            ("1 PC -> METER: 01", "PC", "METER", "PC -> METER"),
            ("a>b", "a", "b", "a>b"),
            ("/dev/tty <- pc.", "/dev/tty", "pc", "/dev/tty <- pc"),
            ("host to slave-1: 01", "host", "slave-1", "host to slave-1"),
        ] {
            let expected = [left, right, range].map(str::to_owned);
            assert_eq!(
                pair(text).map(<[String; 3]>::from),
                Some(expected),
                "{text}"
            );
        }
        for text in [
            "a> b", "a >b", "x < 5", "tx -> rx", "AB -> CD", "-> b", "a ->",
        ] {
            assert_eq!(pair(text), None, "{text}");
        }
    }

    #[test]
    fn common_names_have_a_role() {
        let roles = ["PC1", "master", "Meter_2", "server", "port"].map(role);
        assert_eq!(
            roles,
            [Some(true), Some(true), Some(false), Some(false), None]
        );
        let labels = ["master", "driver", "slave", "cmd", "ack", "port"].map(label);
        assert_eq!(
            labels,
            [Some(true), None, Some(false), Some(true), Some(false), None]
        );
    }

    /// A known role of either end tells the direction. Of two unknown ends that send to each other,
    /// the first sender is the host, and so is one with more peers.
    #[test]
    fn roles_or_the_first_sender_tell_the_host() {
        let host = |texts: &[&str]| -> Vec<(String, bool)> {
            let ends = Ends::of(texts.iter().copied());
            let known = ends.known.into_iter();
            known
                .map(|((sender, _), is_host)| (sender, is_host))
                .collect()
        };
        let known = |sender: &str, is_host| vec![(sender.to_owned(), is_host)];
        assert_eq!(host(&["pc -> foo"]), known("pc", true));
        assert_eq!(host(&["foo -> pc"]), known("foo", false));
        assert_eq!(host(&["foo -> meter"]), known("foo", true));
        assert_eq!(host(&["meter -> sensor"]), []);
        assert_eq!(host(&["foo -> bar"]), []);
        let both = [("bar".to_owned(), false), ("foo".to_owned(), true)];
        assert_eq!(host(&["foo -> bar", "bar -> foo"]), both);
        let both = [("bar".to_owned(), true), ("foo".to_owned(), false)];
        assert_eq!(host(&["bar -> foo", "foo -> bar"]), both);
        let notes = Ends::of(["foo -> bar", "bar -> foo"].into_iter()).notes;
        assert!(
            notes[0].starts_with("\"foo\" is taken as the host"),
            "{notes:?}"
        );
        assert!(Ends::of(["pc -> foo"].into_iter()).notes.is_empty());
    }
}
