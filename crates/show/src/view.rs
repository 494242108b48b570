//! JSON for the live page and report.html, and the script that draws it.
//!
//! The script, `view/view.js`, documents the JSON that each of its functions takes.

use engine::picture::Picture;
pub use engine::run::scene::{Outline, Scene, footprint, millimetres, scene};

/// The drawing functions: a classic script that defines `hilrigView`.
pub const SCRIPT: &str = include_str!("view/view.js");

/// The time line: lanes, marks and plots on a canvas; needs [`SCRIPT`] and defines `hilrigLanes`.
pub const LANES: &str = include_str!("view/lanes.js");

/// Bytes as base64, RFC 4648 section 4, for `bytes` of the script: a third shorter than hex digits.
pub(crate) fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let letters = |[a, b, c]: [u8; 3]| {
        let bits = u32::from_be_bytes([0, a, b, c]);
        let letter = |shift: u32| LETTERS[(bits >> shift & 63) as usize];
        [letter(18), letter(12), letter(6), letter(0)]
    };
    let (groups, rest) = bytes.as_chunks();
    let mut out = vec![0; 4 * groups.len()];
    for (out, &group) in out.as_chunks_mut().0.iter_mut().zip(groups) {
        *out = letters(group);
    }
    if let [a, ..] = *rest {
        let b = rest.get(1).copied();
        let [first, second, third, _] = letters([a, b.unwrap_or(0), 0]);
        out.extend_from_slice(&[first, second, b.map_or(b'=', |_| third), b'=']);
    }
    String::from_utf8(out).expect("letters")
}

/// Encodes a picture as runs of count, red, green and blue, top row first, for `drawPicture` of the
/// script.
pub fn picture_runs(picture: &Picture) -> Vec<u8> {
    let runs = picture.pixels().chunk_by(|a, b| a == b);
    let parts = runs.flat_map(|run| run.chunks(u8::MAX.into()));
    let parts = parts.map(|part| {
        let count = u8::try_from(part.len()).expect("chunks of at most 255");
        let [red, green, blue] = part[0];
        [count, red, green, blue]
    });
    parts.flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test vectors of RFC 4648, section 10.
    #[test]
    fn bytes_are_written_as_the_standard_says() {
        let cases = [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foobar", "Zm9vYmFy"),
        ];
        for (bytes, text) in cases {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    /// 300 pixels of one colour and one of another: runs of 255, 45 and 1.
    #[test]
    fn a_picture_is_runs_of_at_most_255() {
        let mut picture = Picture::from_fn(301, 1, |_, _| [1, 2, 3]);
        picture.put(300, 0, [9, 8, 7]);
        let expected = [255, 1, 2, 3, 45, 1, 2, 3, 1, 9, 8, 7];
        assert_eq!(picture_runs(&picture), expected);
    }
}
