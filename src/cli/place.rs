//! Arguments that set the port of a link: `NAME=PATH`.

use core::str::FromStr;
use std::path::PathBuf;

use super::CliError;

/// A link by name and its port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct NamedPort {
    pub(super) name: String,
    pub(super) path: PathBuf,
}

impl FromStr for NamedPort {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((name, path)) if !name.is_empty() && !path.is_empty() => Ok(Self {
                name: name.to_owned(),
                path: PathBuf::from(path),
            }),
            _ => Err("expected NAME=PATH, e.g. lidar=/dev/ttyUSB0".to_owned()),
        }
    }
}

/// Rejects a name that `option` has twice or that is not in `known`.
pub(super) fn check(option: &str, places: &[NamedPort], known: &[String]) -> Result<(), CliError> {
    for (index, place) in places.iter().enumerate() {
        let name = &place.name;
        if !known.contains(name) {
            return Err(CliError::Usage(format!(
                "{option} {name}={}: no such link; expected one of {}",
                place.path.display(),
                known.join(", ")
            )));
        }
        if places[..index].iter().any(|other| &other.name == name) {
            return Err(CliError::Usage(format!(
                "{option} {name}: given twice, expected each link once"
            )));
        }
    }
    Ok(())
}

/// The port of `name`, if one is given.
pub(super) fn find<'a>(places: &'a [NamedPort], name: &str) -> Option<&'a NamedPort> {
    places.iter().find(|place| place.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_may_contain_an_equals_sign() {
        let place: NamedPort = "lidar=/tmp/a=b".parse().expect("name and path");
        assert_eq!(
            (place.name.as_str(), place.path),
            ("lidar", "/tmp/a=b".into())
        );
    }

    #[test]
    fn a_place_without_name_or_path_says_what_was_expected() {
        for text in ["lidar", "=/dev/x", "lidar="] {
            let error = text.parse::<NamedPort>().expect_err("incomplete");
            assert_eq!(error, "expected NAME=PATH, e.g. lidar=/dev/ttyUSB0");
        }
    }

    #[test]
    fn an_unknown_link_is_named_beside_the_known_ones() {
        let places = ["sonar=/dev/x".parse().expect("complete")];
        let known = ["lidar".to_owned(), "base".to_owned()];
        let error = check("--dut-at", &places, &known).expect_err("unknown");
        assert_eq!(
            error.to_string(),
            "--dut-at sonar=/dev/x: no such link; expected one of lidar, base"
        );
    }

    #[test]
    fn a_link_given_twice_is_refused() {
        let places = ["a=/x".parse().expect("ok"), "a=/y".parse().expect("ok")];
        let error = check("--link", &places, &["a".to_owned()]).expect_err("twice");
        assert_eq!(
            error.to_string(),
            "--link a: given twice, expected each link once"
        );
    }
}
