//! Assignment of channels or analyzers to directions and links.

use super::imported::{Imported, Options, opposite};
use engine::rig::line::Direction;

/// Role of a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Role {
    pub(super) link: String,
    pub(super) direction: Direction,
}

/// Information in the name of a channel.
struct Told {
    direction: Direction,
    /// The rest of the name.
    about: String,
    /// Whether `hilrig export` wrote the name, so that the rest is the link's.
    is_exported: bool,
}

/// Suffixes with which `hilrig export` marks the direction.
const EXPORTED: [(&str, Direction); 2] = [
    (".to-master", Direction::ToMaster),
    (".to-device", Direction::ToDevice),
];
/// Words for received by the host.
const RECEIVED: [&str; 9] = [
    "rx", "rxd", "recv", "receive", "received", "reply", "response", "answer", "device",
];
/// Words for sent by the host.
const SENT: [&str; 9] = [
    "tx", "txd", "send", "sent", "request", "command", "cmd", "transmit", "host",
];
/// Of these, the names of the two ends.
const ENDS: [&str; 2] = ["device", "host"];
/// Words that count only if the name has none of the others.
const BETWEEN: [&str; 2] = ["from", "to"];

/// Roles of channels with these names. A name may contain its role (RX, TX, to-device). Two
/// channels without such names are two directions; more channels are separate links. Two channels
/// with the same role are two links: nothing is merged.
pub(super) fn roles(names: &[String], options: &Options, out: &mut Imported) -> Vec<Role> {
    let told: Vec<Option<Told>> = names.iter().map(|name| of_name(name, options)).collect();
    let mut roles: Vec<Role> = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let role = match (&told[index], &told[..]) {
            (Some(own), all) => of_told(own, all, options),
            (None, [_]) => role(&options.link, options.direction),
            (None, [first, second]) => {
                let other = if index == 0 { second } else { first };
                let other = other.as_ref().map(|other| opposite(other.direction));
                role(&options.link, other.unwrap_or(options.way(index == 0)))
            }
            (None, _) => role(name, options.direction),
        };
        let is_taken = roles.contains(&role);
        roles.push(match is_taken {
            true => self::role(name, role.direction),
            false => role,
        });
    }
    say(names, &told, &roles, options, out);
    roles
}

fn role(link: &str, direction: Direction) -> Role {
    Role {
        link: link.to_owned(),
        direction,
    }
}

/// The role in a name: part of one link, unless the names belong to several links.
fn of_told(own: &Told, all: &[Option<Told>], options: &Options) -> Role {
    let others = all.iter().flatten();
    let is_one = match all {
        [Some(first), Some(second)] => first.direction != second.direction,
        _ => others.into_iter().all(|other| other.about == own.about),
    };
    if own.is_exported || (!is_one && !own.about.is_empty()) {
        return role(&own.about, own.direction);
    }
    role(&options.link, own.direction)
}

/// Name of the link for the path of a port: the text after the last slash.
pub(super) fn link_of_path(path: &str) -> String {
    path.rsplit('/').next().unwrap_or(path).to_owned()
}

fn of_name(name: &str, options: &Options) -> Option<Told> {
    for (end, direction) in EXPORTED {
        if let Some(link) = name.strip_suffix(end) {
            return Some(Told {
                direction,
                about: link.to_owned(),
                is_exported: true,
            });
        }
    }
    let words: Vec<String> = name
        .split(|c: char| !c.is_alphanumeric())
        .map(str::to_lowercase)
        .collect();
    let is_received = |word: &str| word_is(word, &RECEIVED, "rx");
    let is_sent = |word: &str| word_is(word, &SENT, "tx");
    let is_end = |word: &String| is_one_of(word, &ENDS);
    let is_between = words.iter().any(|word| BETWEEN.contains(&word.as_str()));
    let mut marks = words
        .iter()
        .filter(|word| is_received(word) != is_sent(word));
    // "host rx": the word for the action counts, not the one for the end.
    let mark = marks
        .clone()
        .find(|word| !is_end(word))
        .or_else(|| marks.next());
    // "device tx" is received by the host.
    let is_other = !is_between
        && mark.is_some_and(|mark| !is_end(mark))
        && words.iter().any(|word| is_one_of(word, &["device"]))
        && words.iter().position(|word| is_one_of(word, &["device"]))
            < words.iter().position(|word| Some(word) == mark);
    let received = match mark {
        Some(mark) => is_received(mark) != is_other,
        None => {
            let between = words.iter().find(|word| BETWEEN.contains(&word.as_str()))?;
            between == "from"
        }
    };
    let is_about = |word: &&String| {
        let word = word.as_str();
        !(word.is_empty() || is_received(word) || is_sent(word) || BETWEEN.contains(&word))
    };
    let about: Vec<&str> = words.iter().filter(is_about).map(String::as_str).collect();
    Some(Told {
        direction: options.way(received),
        about: about.join("-"),
        is_exported: false,
    })
}

/// Whether a word is one of `words`, perhaps with a number, or ends with `end`.
fn word_is(word: &str, words: &[&str], end: &str) -> bool {
    let plain = word.trim_end_matches(|c: char| c.is_ascii_digit());
    words.contains(&plain) || plain.ends_with(end)
}

/// Whether a word is one of `words`, perhaps with a number.
fn is_one_of(word: &str, words: &[&str]) -> bool {
    words.contains(&word.trim_end_matches(|c: char| c.is_ascii_digit()))
}

/// Notes the assignment, unless the file contains it.
fn say(
    names: &[String],
    told: &[Option<Told>],
    roles: &[Role],
    options: &Options,
    out: &mut Imported,
) {
    let is_plain = names.len() == 1 && told[0].is_none();
    if is_plain || told.iter().flatten().any(|told| told.is_exported) {
        return;
    }
    for (name, role) in names.iter().zip(roles) {
        let way = match role.direction {
            Direction::ToMaster => "from the device",
            Direction::ToDevice => "to the device",
        };
        let link = match role.link == options.link {
            true => String::new(),
            false => format!(", link \"{}\"", role.link),
        };
        out.note(format!("\"{name}\" is taken as {way}{link}"));
    }
    if told.iter().any(Option::is_none) || names.len() == 1 {
        out.note("--from program exchanges the directions");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(names: &[&str]) -> Vec<(String, bool)> {
        let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        let roles = roles(&names, &Options::default(), &mut Imported::new());
        let pair = |role: Role| (role.link, role.direction == Direction::ToDevice);
        roles.into_iter().map(pair).collect()
    }

    fn role(link: &str, is_sent: bool) -> (String, bool) {
        (link.to_owned(), is_sent)
    }

    #[test]
    fn a_name_tells_its_direction() {
        let both = [role("line", false), role("line", true)];
        for names in [
            ["RX from lidar", "TX to lidar"],
            ["uart_rx", "uart_tx"],
            ["RXD0", "TXD0"],
            ["from lidar", "to lidar"],
            ["D0", "D1"],
            ["RX", "D1"],
            ["D0", "TX"],
            ["gps rx", "base tx"],
            ["HOST RX", "HOST TX"],
            ["Host-Rx", "Host-Tx"],
            ["device tx", "device rx"],
            ["Device", "Host"],
        ] {
            assert_eq!(of(&names), both, "{names:?}");
        }
        assert_eq!(of(&["TX", "RX"]), [role("line", true), role("line", false)]);
        assert_eq!(of(&["D3"]), [role("line", false)]);
        assert_eq!(of(&["TX"]), [role("line", true)]);
    }

    #[test]
    fn nothing_is_merged() {
        let four = of(&["RX gps", "TX gps", "RX base", "TX base"]);
        let expected = [
            role("gps", false),
            role("gps", true),
            role("base", false),
            role("base", true),
        ];
        assert_eq!(four, expected);
        assert_eq!(of(&["a", "b", "c"]).len(), 3);
        assert_eq!(of(&["a", "b", "c"])[2], role("c", false));
        assert_eq!(of(&["RX", "RX"])[1], role("RX", false));
        let exported = of(&["lidar.to-master", "lidar.to-device", "base.to-master"]);
        let expected = [
            role("lidar", false),
            role("lidar", true),
            role("base", false),
        ];
        assert_eq!(exported, expected);
    }

    /// The notes about the roles of these names.
    fn notes(names: &[&str]) -> Vec<String> {
        let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        let mut out = Imported::new();
        roles(&names, &Options::default(), &mut out);
        out.notes
    }

    /// What was assumed can be turned round; what a name tells needs no such note.
    #[test]
    fn assumed_roles_are_noted() {
        let other = "--from program exchanges the directions";
        assert_eq!(
            notes(&["D0", "D1"]),
            [
                "\"D0\" is taken as from the device",
                "\"D1\" is taken as to the device",
                other
            ]
        );
        assert_eq!(notes(&["RX", "TX"]).len(), 2);
        assert_eq!(
            notes(&["RX"]),
            ["\"RX\" is taken as from the device", other]
        );
        assert!(notes(&["D3"]).is_empty());
        assert!(notes(&["a.to-master", "b"]).is_empty());
        assert_eq!(
            notes(&["RX gps", "RX base"]),
            [
                "\"RX gps\" is taken as from the device, link \"gps\"",
                "\"RX base\" is taken as from the device, link \"base\""
            ]
        );
    }

    /// Words of one channel: the action counts before the end, and "from" and "to" only alone.
    #[test]
    fn the_words_of_a_name_have_an_order() {
        let of = |name: &str| {
            let told = of_name(name, &Options::default())?;
            Some((told.direction == Direction::ToDevice, told.about))
        };
        for (name, expected) in [
            ("device tx", Some((false, ""))),
            ("tx device", Some((true, ""))),
            ("tx to device", Some((true, ""))),
            ("device", Some((false, ""))),
            ("host 2", Some((true, "2"))),
            ("from gps", Some((false, "gps"))),
            ("to gps", Some((true, "gps"))),
            ("uart2_txd1", Some((true, "uart2"))),
            ("request lift-a", Some((true, "lift-a"))),
            ("gps", None),
        ] {
            let expected = expected.map(|(is_sent, about)| (is_sent, about.to_owned()));
            assert_eq!(of(name), expected, "{name}");
        }
    }

    #[test]
    fn a_link_has_the_name_behind_the_last_slash() {
        let found = ["/dev/ttyUSB0", "COM3", "/dev/"].map(link_of_path);
        assert_eq!(found, ["ttyUSB0", "COM3", ""]);
    }

    /// A single channel, and several of one device, are the link of the options.
    #[test]
    fn one_device_is_one_link() {
        assert_eq!(of(&["TX gps"]), [role("line", true)]);
        let one = ["RX gps", "TX gps", "rx gps"].map(str::to_owned);
        let told = one.map(|name| of_name(&name, &Options::default()));
        let first = told[0].as_ref().expect("a direction");
        let found = of_told(first, &told, &Options::default());
        assert_eq!(
            (&*found.link, found.direction),
            ("line", Direction::ToMaster)
        );
    }
}
