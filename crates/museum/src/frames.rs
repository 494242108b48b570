//! Frames of the PC link, as a PC sends them.

use protocols::pcui::message::{self, Order, Waypoint};
use protocols::pcui::{self, FRAME_MAX, HEADER_LEN};

/// A frame of the PC link.
pub(super) fn frame(id: &[u8; 3], payload: &[u8]) -> Vec<u8> {
    let mut bytes = [0; FRAME_MAX];
    bytes[HEADER_LEN..HEADER_LEN + payload.len()].copy_from_slice(payload);
    let len = pcui::seal(&mut bytes, *id, payload.len()).expect("at most 511 bytes");
    bytes[..len].to_vec()
}

/// A list of waypoints with these ids and links, one after the other along x.
pub(super) fn list(links: &[[i16; 2]]) -> Vec<Waypoint> {
    let waypoints = (1..).zip(links).map(|(x, &[id, previous])| Waypoint {
        position_mm: [x * 5, 5],
        layer: 0,
        id,
        previous,
    });
    waypoints.collect()
}

/// Waypoints as a sound PC links them.
pub(super) fn chain(count: i16) -> Vec<Waypoint> {
    let links: Vec<_> = (0..count).map(|id| [id, id - 1]).collect();
    list(&links)
}

/// A frame with this list.
pub(super) fn list_frame(waypoints: &[Waypoint]) -> Vec<u8> {
    let mut bytes = [0; FRAME_MAX];
    let len = message::encode_waypoints(waypoints.iter().copied(), &mut bytes);
    bytes[..len.expect("at most 56")].to_vec()
}

/// A frame with this order.
pub(super) fn order(mode: message::Mode, set_point: [i8; 2]) -> Vec<u8> {
    let mut bytes = [0; FRAME_MAX];
    let len = message::encode_order(&Order { mode, set_point }, &mut bytes);
    bytes[..len.expect("twenty bytes")].to_vec()
}
