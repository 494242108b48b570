//! Events in the empty room, as additional TOML.

use protocols::pcui::{FRAME_MAX, HEADER_LEN, seal};

/// A path through the room.
pub(super) fn way() -> String {
    "[mission]\nto_the_end = true\nwaypoints_m = [[1.5, 2.2], [0.8, 1.5], [1.5, 1.0]]\n".to_owned()
}

pub(super) fn way_with_other_dice() -> String {
    "seed = 2\n".to_owned() + &way()
}

fn fault(link: &str, direction: &str, rest: &str) -> String {
    format!("[[fault]]\nlink = \"{link}\"\ndirection = \"{direction}\"\n{rest}\n")
}

fn strike(kind: &str, rest: &str) -> String {
    fault("base", "to-master", &format!("kind = \"{kind}\"\n{rest}"))
}

/// The first reply's byte 2 is 8A, W and a count of ten; a burst changes it to FE, a count of 126.
pub(super) fn count_of_126() -> String {
    way() + &strike("burst", "byte = 2\nlen = 1\nvalue = 0x74")
}

/// Replaces bytes of the original sender, from byte `at` on, by these bytes.
fn says(link: &str, at: u32, bytes: &[u8]) -> String {
    let insert = |value| format!("kind = \"insert\"\nbyte = {at}\nvalue = {value}");
    let each = bytes
        .iter()
        .map(|value| fault(link, "to-master", &insert(value)));
    each.collect()
}

/// Inserts a frame of the PC before its next frame.
fn pc_says(id: &[u8; 3], payload: &[u8]) -> String {
    let mut frame = [0; FRAME_MAX];
    frame[HEADER_LEN..HEADER_LEN + payload.len()].copy_from_slice(payload);
    let len = seal(&mut frame, *id, payload.len()).expect("short");
    says("radio", 0, &frame[..len])
}

pub(super) fn frame_without_payload() -> String {
    way() + &pc_says(b"STA", &[])
}

/// A waypoint as encoded in a list: position, layer, number, predecessor.
const fn waypoint(place: u8, id: u8, previous: [u8; 2]) -> [u8; 9] {
    [place, 0, place, 0, 0, id, 0, previous[0], previous[1]]
}

const NOBODY: [u8; 2] = [0xFF, 0xFF];

/// A list that announces 50 waypoints and contains one.
pub(super) fn list_that_lies() -> String {
    let list = [&[50, 0][..], &waypoint(9, 0, NOBODY)].concat();
    by_hand() + &pc_says(b"LWP", &list)
}

/// The catalogue's list.
pub(super) fn link_to_nobody() -> String {
    let list = [
        &[2, 0][..],
        &waypoint(2, 1, NOBODY),
        &waypoint(5, 0, [1, 0]),
    ]
    .concat();
    by_hand() + &pc_says(b"LWP", &list)
}

pub(super) fn two_behind_one() -> String {
    let behind = |id| waypoint(9, id, [0, 0]);
    let list = [&[3, 0][..], &waypoint(9, 0, NOBODY), &behind(1), &behind(2)].concat();
    by_hand() + &pc_says(b"LWP", &list)
}

/// Position before the second answer to a read of the wheels: the first answer has 15 bytes, the
/// battery's has 8.
const SECOND_ANSWER: u32 = 23;

/// Two bytes instead of ten; the rest of the buffer has the battery's bytes.
pub(super) fn short_reply() -> String {
    way()
        + &says(
            "base",
            SECOND_ANSWER,
            &[0xAB, 0x24, 0x82, 0x09, 0x09, 0x63, 0x01],
        )
}

/// The empty frame of register 36; the rest of the buffer has the battery's bytes.
pub(super) fn acknowledgement() -> String {
    way() + &says("base", SECOND_ANSWER, &[0xAB, 0x24, 0x00, 0xCF, 0x00])
}

pub(super) fn late_base() -> String {
    way() + "[[fault]]\nkind = \"delayed\"\ndevice = \"base\"\nby = \"6ms\"\nfrom = \"3s\"\n"
}

pub(super) fn no_base() -> String {
    way() + &strike("cut", "from = \"3s\"")
}

pub(super) fn noisy_lidar() -> String {
    let noise = |kind| format!("kind = \"{kind}\"\nrate = 0.004\nfrom = \"2s\"");
    let each = ["flip", "drop", "insert"].map(|kind| fault("lidar", "to-master", &noise(kind)));
    way() + &each.concat()
}

pub(super) fn flipped_lidar() -> String {
    rest()
        + &fault(
            "lidar",
            "to-master",
            "kind = \"flip\"\nrate = 0.004\nfrom = \"2s\"",
        )
}

pub(super) fn no_lidar() -> String {
    way() + &fault("lidar", "to-master", "kind = \"cut\"\nfrom = \"4s\"")
}

/// A lidar that is blind from the beginning.
const DARK: &str = "[device.lidar.xv11]\nfaults = [\"dark\"]\n";

pub(super) fn dark_exploration() -> String {
    format!("[program]\nstart_mode = \"exploration\"\n{DARK}")
}

pub(super) fn no_beams() -> String {
    rest() + "[[fault]]\ndevice = \"lidar\"\nkind = \"device\"\nfault = \"dark\"\nuntil = \"38s\"\n"
}

pub(super) fn rest() -> String {
    "[mission]\nto_the_end = true\n".to_owned()
}

fn hand(set_point: [i8; 2]) -> String {
    let [left, right] = set_point;
    let step = format!("[[mission.step]]\nat = \"4s\"\ndo = {{ drive = [{left}, {right}] }}\n");
    rest() + &step
}

pub(super) fn spin() -> String {
    hand([-20, 20]).replace("\"4s\"", "\"600ms\"")
}

pub(super) fn backwards_in_the_dark() -> String {
    hand([-15, -15]) + DARK
}

pub(super) fn by_hand() -> String {
    hand([10, -10])
}

/// The PC disconnects a second after its order.
pub(super) fn hand_gone() -> String {
    hand([10, -10]) + "[[mission.step]]\nat = \"5s\"\ndo = \"disconnect\"\n"
}

/// A stray byte before the PC's first frame.
pub(super) fn stray_p() -> String {
    way()
        + &fault(
            "radio",
            "to-master",
            "kind = \"insert\"\nbyte = 0\nvalue = 0x50",
        )
}

fn list(count: u32, [x, y]: [f64; 2]) -> String {
    let places = (0..count).map(|_| format!("[{x}, {y}]"));
    let places = places.collect::<Vec<_>>().join(", ");
    format!("[mission]\nto_the_end = true\nwaypoints_m = [{places}]\n")
}

/// A list of 56 places at 0AFF: the sum is 81F7.
pub(super) fn list_of_high_sum() -> String {
    list(56, [2.815, 2.815])
}

/// Byte 9 is the high half of the first frame's length.
pub(super) fn negative_length() -> String {
    let hit = "kind = \"burst\"\nbyte = 9\nlen = 1\nvalue = 0x80";
    way() + &fault("radio", "to-master", hit)
}

/// A list of 21 waypoints: 19 bytes, and 9 for each waypoint, are 208.
pub(super) fn list_of_21() -> String {
    list(21, [1.5, 2.2])
}

/// A list of 20 waypoints: 199 bytes.
pub(super) fn list_of_20() -> String {
    list(20, [1.5, 2.2])
}

/// While the robot drives to the third waypoint, it gets a list with one waypoint.
pub(super) fn shorter_list() -> String {
    "[mission]\nto_the_end = true\nwaypoints_m = [[1.5, 1.25], [1.5, 1.3], [1.5, 2.2]]\n\
     [[mission.step]]\nat = \"6s\"\ndo = { waypoints-m = [[0.9, 0.9]] }\n"
        .to_owned()
}

pub(super) fn empty_list() -> String {
    way() + "[[mission.step]]\nat = \"4s\"\ndo = { waypoints-m = [] }\n"
}

/// The link is switched off on the display before a list of 30 arrives, and on again afterwards.
pub(super) fn list_while_off() -> String {
    let places = ["[1.5, 2.2]"; 30].join(", ");
    format!(
        "[mission]\nto_the_end = true\n[[mission.step]]\nat = \"4s\"\n\
         do = {{ waypoints-m = [{places}] }}\n[device.display.touch-panel]\ntap = [\
         {{ at = \"2s\", place = [400, 256] }}, {{ at = \"3s\", place = [410, 50] }}, \
         {{ at = \"5s\", place = [410, 50] }}]\n"
    )
}

pub(super) fn stop() -> String {
    way() + "[[mission.step]]\nat = \"6s\"\ndo = { mode = \"stop\" }\n"
}

/// Manual driving turns the robot from 90 to some -10 degrees, psi -170; the position lies at psi
/// 170.
pub(super) fn past_the_seam() -> String {
    hand([10, -10]).replace("\"4s\"", "\"600ms\"")
        + "[[mission.step]]\nat = \"3500ms\"\ndo = { waypoints-m = [[2.4, 1.36]] }\n\
           [[mission.step]]\nat = \"3550ms\"\ndo = { mode = \"waypoint\" }\n"
}

/// Two turns and a third to the right, then a position straight ahead of the robot's first heading.
pub(super) fn two_turns() -> String {
    hand([20, -20]).replace("\"4s\"", "\"600ms\"")
        + "[[mission.step]]\nat = \"9900ms\"\ndo = { waypoints-m = [[1.5, 2.2]] }\n\
           [[mission.step]]\nat = \"9950ms\"\ndo = { mode = \"waypoint\" }\n"
}

/// Mapping is switched off on the display while the robot is driven manually, then on again.
pub(super) fn mapping_off() -> String {
    hand([15, 15])
        + "[[mission.step]]\nat = \"7s\"\ndo = { mode = \"stop\" }\n\
           [device.display.touch-panel]\ntap = [{ at = \"3s\", place = [410, 90] }, \
           { at = \"8s\", place = [410, 90] }]\n"
}
