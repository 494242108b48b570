//! Names of the rules that devices log, to find misspelt names.

use crate::near;

/// Rules of a slave of registers.
const OF_REGISTERS: [&str; 14] = [
    "bad-checksum",
    "board-deaf",
    "board-reset",
    "break",
    "frame-cut-off",
    "made-safe",
    "not-driven",
    "out-of-range",
    "queue-full",
    "request-before-reply",
    "stray-bytes",
    "unknown-register",
    "value-cut",
    "write-read-only",
];

/// Rules of a slave of text lines.
const OF_TEXT: [&str; 9] = [
    "board-deaf",
    "board-reset",
    "break",
    "line-too-long",
    "made-safe",
    "not-driven",
    "out-of-range",
    "queue-full",
    "unknown-request",
];

/// Rules of a device that a file describes.
const OF_DESCRIPTION: [&str; 25] = [
    "bad-character",
    "bad-checksum",
    "bad-frame",
    "bad-length",
    "bad-request",
    "expression-failed",
    "frame-cut-off",
    "frame-too-long",
    "made-safe",
    "missing-pause",
    "not-answered",
    "not-ready",
    "off",
    "out-of-range",
    "output-full",
    "queue-full",
    "request-before-reply",
    "restarted",
    "too-fast",
    "too-many-delays",
    "unknown-function",
    "unknown-message",
    "unknown-register",
    "value-cut",
    "wrong-address",
];

/// Rules that other devices, the links and the rig log. A name similar to one of these is misspelt.
/// Other names may belong to a program or to another crate.
const OF_OTHERS: [&str; 75] = [
    "bad-message",
    "bad-row",
    "battery-low",
    "booted",
    "bytes-injected",
    "bytes-while-busy",
    "bytes-while-starting",
    "command-too-slow",
    "command-while-connected",
    "connected",
    "count-too-large",
    "data-in-command-mode",
    "dead-man",
    "disconnected",
    "display-off",
    "display-on",
    "duty-without-driver",
    "encoder-lost",
    "fault-added",
    "fault-begun",
    "fault-ended",
    "fifo-overflow",
    "frame-vanished",
    "framing-error",
    "gap-in-frame",
    "host-gave-up",
    "host-overflow",
    "host-port-closed",
    "imu-off",
    "imu-stuck",
    "imu-wrong",
    "line-coding-changed",
    "line-end-after-command",
    "line-end-missing",
    "line-lost",
    "lower-case-command",
    "map-complete",
    "map-size",
    "message-lost",
    "mode-not-supported",
    "motor-not-wired",
    "motors-on",
    "motors-stopped",
    "no-answer",
    "no-pause-between-commands",
    "open-channel",
    "order-confirmed",
    "order-not-confirmed",
    "out-of-reach",
    "pixel-count",
    "port-closed",
    "port-opened",
    "port-overrun",
    "power-off",
    "power-on",
    "protection-stop",
    "radio-back",
    "radio-lost",
    "request-cut",
    "request-damaged",
    "request-not-supported",
    "request-unknown",
    "request-while-busy",
    "robot-message",
    "robot-says",
    "rotation-stable",
    "rotation-unstable",
    "set-point-out-of-range",
    "settings-changed",
    "stand-by",
    "unknown-command",
    "value-set",
    "waypoints-confirmed",
    "window-outside",
    "wrong-baud",
];

/// Knowledge of a rule by its name and by the device that the condition names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Known {
    /// The device logs it.
    Logged,
    /// The device logs other rules only.
    NeverLogged,
    /// The name is similar to this known name, which was probably meant.
    Misspelt(&'static str),
    /// Other devices log the rule, and this device may log it as well.
    OfOthers,
    /// Nothing is known of the name: the device may be a program.
    Open,
    /// As [`Open`](Self::Open): the device is a program, and the scenario does not list its events.
    Undeclared,
}

/// The rules of a device of the kind `kind`, if all of them are known.
fn all_of(kind: Option<&str>) -> Option<&'static [&'static str]> {
    match kind? {
        "registers" => Some(&OF_REGISTERS),
        "text" => Some(&OF_TEXT),
        "description" => Some(&OF_DESCRIPTION),
        _ => None,
    }
}

/// A message with the expected names if `rule` cannot be logged: neither by a device of the kind
/// `kind` with its `own_rules` or `declared` events, nor by the rig in the name of this device.
pub(crate) fn unknown(
    kind: Option<&str>,
    own_rules: &[&str],
    declared: Option<&[String]>,
    rule: &str,
) -> Option<String> {
    let declared: Option<Vec<&str>> =
        declared.map(|declared| declared.iter().map(String::as_str).collect());
    let of_kind = declared.as_deref().or_else(|| all_of(kind))?;
    let own = [own_rules, of_kind].concat();
    let is_known = own.contains(&rule) || OF_OTHERS.contains(&rule);
    (!is_known).then(|| near::expected(rule, &own))
}

/// Knowledge of `rule` for a device of the kind `kind`.
pub(crate) fn known(kind: Option<&str>, rule: &str) -> Known {
    let Some(own) = all_of(kind) else {
        let all = [&OF_REGISTERS[..], &OF_TEXT, &OF_DESCRIPTION, &OF_OTHERS].concat();
        return match near::misspelt(rule, &all) {
            Some(meant) => Known::Misspelt(meant),
            None if all.contains(&rule) => Known::OfOthers,
            None if kind == Some("program") => Known::Undeclared,
            None => Known::Open,
        };
    };
    match (own.contains(&rule), near::misspelt(rule, own)) {
        (true, _) => Known::Logged,
        (false, _) if OF_OTHERS.contains(&rule) => Known::OfOthers,
        (false, Some(meant)) => Known::Misspelt(meant),
        (false, None) => Known::NeverLogged,
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// Each name of the lists occurs in the code of a device.
    #[test]
    fn the_lists_hold_names_of_the_code() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let mut code = String::new();
        for folder in ["emulators/src", "crates"] {
            read(&root.join(folder), &mut code);
        }
        let all = [&OF_REGISTERS[..], &OF_TEXT, &OF_DESCRIPTION, &OF_OTHERS].concat();
        let unknown = all
            .iter()
            .filter(|name| !code.contains(&format!("\"{name}\"")));
        assert_eq!(unknown.collect::<Vec<_>>(), [&""; 0]);
        for list in [&OF_REGISTERS[..], &OF_TEXT, &OF_DESCRIPTION, &OF_OTHERS] {
            assert!(list.is_sorted(), "{list:?}");
        }
    }

    /// The rig logs in the name of a device as well.
    #[test]
    fn an_unknown_rule_is_told_with_the_known_ones() {
        let declared = ["tare-lost".to_owned(), "overload".to_owned()];
        let of_program = |rule| unknown(Some("program"), &[], Some(&declared), rule);
        assert_eq!(of_program("overload"), None);
        assert_eq!(of_program("port-opened"), None);
        let message = of_program("overlaod").expect("misspelt");
        assert!(message.contains("did you mean \"overload\"?"), "{message}");
        assert_eq!(unknown(Some("program"), &[], None, "overlaod"), None);
        assert_eq!(unknown(None, &[], None, "overlaod"), None);
        assert_eq!(unknown(Some("text"), &[], None, "unknown-request"), None);
        let message = unknown(Some("text"), &[], None, "wieght").expect("no rule of it");
        assert!(message.contains("unknown-request"), "{message}");
        let message = unknown(Some("description"), &["overload"], None, "overlaod");
        let message = message.expect("misspelt");
        assert!(
            message.contains("\"overload\"? Expected one of overload, bad-"),
            "{message}"
        );
    }

    fn read(folder: &Path, into: &mut String) {
        for entry in std::fs::read_dir(folder).expect("is there").flatten() {
            let path = entry.path();
            let is_this = path.ends_with("log_rules.rs") || path.ends_with("target");
            match path.extension() {
                _ if is_this => {}
                Some(end) if end == "rs" => *into += &std::fs::read_to_string(path).expect("text"),
                _ if path.is_dir() => read(&path, into),
                _ => {}
            }
        }
    }

    #[test]
    fn a_misspelt_rule_is_found_for_each_kind_of_source() {
        let rows = [
            (Some("registers"), "bad-checksum", Known::Logged),
            (
                Some("registers"),
                "bad-cheksum",
                Known::Misspelt("bad-checksum"),
            ),
            (Some("description"), "wieght", Known::NeverLogged),
            (Some("description"), "to-fast", Known::Misspelt("too-fast")),
            (
                Some("text"),
                "unknown-reqest",
                Known::Misspelt("unknown-request"),
            ),
            (Some("program"), "tare-lost", Known::Undeclared),
            (Some("firmware"), "tare-lost", Known::Open),
            (Some("text"), "port-opened", Known::OfOthers),
            (None, "motor-stopped", Known::Misspelt("motors-stopped")),
            (None, "motors-stopped", Known::OfOthers),
        ];
        for (kind, rule, known_of_it) in rows {
            assert_eq!(known(kind, rule), known_of_it, "{kind:?} {rule}");
        }
    }
}
