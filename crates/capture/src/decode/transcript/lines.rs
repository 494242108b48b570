//! Text outside of frames, with damaged frames of text in it.

use super::entry::Said;
use engine::codec::{Codec, What, words};
use engine::rig::line::Direction;

/// The lines of a text, each with its offset: a line that is a frame except for its checksum is
/// damage, the others are text.
pub(super) fn texts(run: &[u8], of: Option<(&'static Codec, Direction)>) -> Vec<(usize, Said)> {
    let is_damaged = |line: &&[u8]| {
        let mut repaired = line.to_vec();
        of.is_some_and(|(codec, direction)| {
            codec.repair(&mut repaired);
            let frames = codec.frames_towards(&repaired, direction);
            let is_whole = frames.first() == Some(&(0..line.len() as u64));
            repaired != *line && is_whole
        })
    };
    let lines: Vec<&[u8]> = run.split_inclusive(|byte| *byte == b'\n').collect();
    let (mut all, mut start) = (Vec::new(), 0);
    for group in lines.chunk_by(|a, b| !is_damaged(a) && !is_damaged(b)) {
        let text = group.concat();
        let damage = of
            .filter(|_| is_damaged(&group[0]))
            .map(|(codec, direction)| {
                let found = codec.found_towards(&text, direction).into_iter();
                let errors = found.filter_map(|one| match one.what {
                    What::Bad(errors) => Some(errors),
                    What::Frame(_) => None,
                });
                Said::Bad(text.clone(), errors.flatten().collect())
            });
        all.push((
            start,
            damage.unwrap_or_else(|| Said::Text(words::text(&text))),
        ));
        start += text.len();
    }
    all
}
