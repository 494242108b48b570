//! Settings as words of text, for firmware on a simulated board: the scenario's settings reach the
//! board as `KEY=VALUE`.

use core::fmt::{self, Debug, Display, Write};
use core::str::FromStr;

use crate::grid;
use crate::pose::Pose;

/// Takes a key and its value.
pub type Report<'a> = dyn FnMut(&'static str, &dyn Display) + 'a;

/// Reports the basis of the words: the size of the map and the hash of `default`.
pub(super) fn tell_basis(default: &impl Debug, report: &mut Report<'_>) {
    report("map", &grid::SIDE);
    report("defaults", &hash_of(default));
}

/// Compares the basis of the words with that of this build; `None`: the key is another one.
pub(super) fn check_basis(
    default: &impl Debug,
    key: &str,
    value: &str,
) -> Option<Result<(), &'static str>> {
    let (is_same, expected) = match key {
        "map" => (
            number(value) == Ok(grid::SIDE),
            "is the side of hilrig's map, but not of this firmware's; build both with the same \
             features",
        ),
        "defaults" => (
            number(value) == Ok(hash_of(default)),
            "comes from other defaults or another version; build hilrig and this firmware from the \
             same source",
        ),
        _ => return None,
    };
    Some(is_same.then_some(()).ok_or(expected))
}

/// FNV-1a of the version and of each default, 32 bits.
fn hash_of(default: &impl Debug) -> u32 {
    struct Hash(u32);
    impl Write for Hash {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            for byte in text.bytes() {
                self.0 = (self.0 ^ u32::from(byte)).wrapping_mul(0x0100_0193);
            }
            Ok(())
        }
    }
    let mut hash = Hash(0x811C_9DC5);
    // Writing into the hash cannot fail.
    let _ = write!(hash, "{} {default:?}", env!("CARGO_PKG_VERSION"));
    hash.0
}

/// Reports the start pose.
pub(super) fn tell_start(start: Pose, report: &mut Report<'_>) {
    report("x_mm", &start.x_mm);
    report("y_mm", &start.y_mm);
    report("heading", &start.heading);
}

/// Sets a number of the start pose; `None`: the key is another one.
pub(super) fn set_start(
    start: &mut Pose,
    key: &str,
    value: &str,
) -> Option<Result<(), &'static str>> {
    let place = match key {
        "x_mm" => &mut start.x_mm,
        "y_mm" => &mut start.y_mm,
        "heading" => &mut start.heading,
        _ => return None,
    };
    Some(number(value).map(|number| *place = number))
}

/// Parses `value` as a number.
pub(super) fn number<T: FromStr>(value: &str) -> Result<T, &'static str> {
    value.parse().map_err(|_| "expected a number")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_words_have_another_basis() {
        let one = hash_of(&(1, 2.5_f32));
        assert_ne!(one, hash_of(&(1, 2.500_000_2_f32)));
        let mut reported = 0;
        tell_basis(&(1, 2.5_f32), &mut |key, value| {
            extern crate std;
            let value = std::string::ToString::to_string(value);
            assert_eq!(check_basis(&(1, 2.5_f32), key, &value), Some(Ok(())));
            let other = check_basis(&(1, 2.5_f32), key, "7");
            assert!(other.is_some_and(|checked| checked.is_err()), "{key}");
            reported += 1;
        });
        assert_eq!(reported, 2);
        assert_eq!(check_basis(&0, "seed", "1"), None);
    }
}
