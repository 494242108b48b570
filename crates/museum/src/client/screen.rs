//! Display of received data by the PC program.

use super::{Operator, properties, robots_list};
use crate::frames::frame;
use crate::{Observation, Variant};

/// An uncompressed row of the map: 14, 28, 42 and so on.
fn plain_row(id: &[u8; 3], y: u8) -> Vec<u8> {
    let pixels = (1..=300_u16).map(|x| (14 * x).to_le_bytes()[0]);
    frame(id, &[0, y, 0].into_iter().chain(pixels).collect::<Vec<_>>())
}

fn joined(values: &[impl ToString]) -> String {
    let values: Vec<_> = values.iter().map(ToString::to_string).collect();
    values.join(", ")
}

/// 'P' is 50 and 'R' is 52 in hex: read as pairs of count and value, the row begins with fourteen
/// times 28.
pub(super) fn ui_01(variant: Variant) -> Observation {
    let mut desk = Operator::with_map(variant);
    desk.take(&plain_row(b"MAP", 7));
    let mut flipped = plain_row(b"MAP", 7);
    flipped[16] ^= 0x02;
    desk.receive(&flipped);
    let row = desk.cells()[7 * 300..].first_chunk().copied();
    let first: [u8; 3] = row.unwrap_or_default();
    desk.seen.figure("first pixels of the row", joined(&first));
    desk.judged(first == [28; 3])
}

/// Half a pair, a row below the map, frames that end before their fields do, cells without size.
pub(super) fn ui_02(variant: Variant) -> Observation {
    let odd = [
        frame(b"MAR", &[0, 0, 0, 255]),
        frame(b"MAP", &[&[0, 0x2C, 1][..], &[0; 300]].concat()),
        frame(b"MAP", &[0]),
        frame(b"MPD", &[]),
        properties(0, [3_000, 3_000], [0, 0], 0),
        frame(b"LWP", &[5, 0]),
    ];
    let mut seen = Observation::default();
    let mut deaf = 0;
    for one in &odd {
        let mut desk = Operator::with_map(variant);
        desk.receive(one);
        desk.take(&properties(10, [3_000, 3_000], [1_234, 5], 0));
        deaf += usize::from(desk.pose() != Some([1_234, 5, 0]));
        seen.wire.append(&mut desk.seen.wire);
    }
    seen.figure(
        "of 6 invalid frames, those after which the program ignores all others",
        deaf,
    );
    seen.judged(deaf == odd.len())
}

pub(super) fn ui_03(variant: Variant) -> Observation {
    let mut desk = Operator::new(variant);
    desk.receive(&properties(10, [3_000, 3_000], [-10, 0], -90));
    let pose = desk.pose().unwrap_or_default();
    desk.seen.figure("x, y and psi as shown", joined(&pose));
    desk.judged(pose == [65_526, 0, 65_446])
}

pub(super) fn ui_04(variant: Variant) -> Observation {
    let mut desk = Operator::with_map(variant);
    desk.receive(&robots_list(&[[-20, 5]]));
    let places = desk.places();
    desk.seen
        .figure("waypoint as shown", joined(places.as_flattened()));
    desk.judged(places == [[65_516, 5]])
}

pub(super) fn ui_08(variant: Variant) -> Observation {
    let mut desk = Operator::new(variant);
    let pose = properties(20, [6_000, 6_000], [1_000, 1_000], 90);
    desk.receive(&[b"P", &*pose].concat());
    let shown = desk.pose();
    let told = shown.map_or("none".to_owned(), |pose| joined(&pose));
    desk.seen.figure("x, y and psi as shown", told);
    desk.judged(shown.is_none())
}

/// Four columns and two rows; the second row is at the top of the screen.
pub(super) fn ui_09(variant: Variant) -> Observation {
    let mut desk = Operator::new(variant);
    desk.take(&properties(10, [40, 20], [0, 0], 0));
    desk.take(&frame(b"MAP", &[0, 0, 0, 9, 9, 9, 9]));
    desk.receive(&frame(b"MAP", &[0, 1, 0, 1, 2, 3, 4]));
    let pixels = joined(&desk.painting());
    desk.seen.figure("pixels from the top", &pixels);
    desk.judged(pixels == "1, 2, 9, 9, 9, 9, 0, 0")
}

/// The fielded robot's encoding of a row: its last pixel is never counted.
pub(super) fn ui_10(variant: Variant) -> Observation {
    let mut desk = Operator::with_map(variant);
    desk.receive(&frame(b"MAR", &[0, 0, 0, 255, 255, 44, 255]));
    let [before, last] = [298, 299].map(|x| desk.cells().get(x).copied().unwrap_or_default());
    desk.seen.figure("column 298, a wall", before);
    desk.seen.figure("column 299, not told", last);
    desk.judged(last == 0)
}
