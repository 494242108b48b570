//! What the live page and report.html show, as plain JSON, and the script that draws it.
//!
//! The script, `view/view.js`, documents the JSON that each of its functions takes.

use crate::picture::Picture;
pub use crate::run::scene::{Outline, Scene, footprint, millimetres, scene};

/// The drawing functions: a classic script that defines `hilrigView`.
pub const SCRIPT: &str = include_str!("view/view.js");

/// A picture as runs of count, red, green and blue, top row first: `drawPicture` of the script.
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

    /// 300 pixels of one colour and one of another: 255, 45 and 1.
    #[test]
    fn a_picture_is_runs_of_at_most_255() {
        let mut picture = Picture::from_fn(301, 1, |_, _| [1, 2, 3]);
        picture.put(300, 0, [9, 8, 7]);
        let expected = [255, 1, 2, 3, 45, 1, 2, 3, 1, 9, 8, 7];
        assert_eq!(picture_runs(&picture), expected);
    }
}
