//! A blind test: a plain classifier tries to distinguish windows of a real capture from windows of
//! the emulated sensor in the same room. Its accuracy is the figure: 50 % is chance.
//!
//! A window is two turns. Half of the windows train the classifier, the others are judged, and then
//! the other way round. Only repeating readings count as the room: moving objects, edges and
//! corners are left out of both streams.

#[cfg(test)]
mod tests;

use protocols::xv11::{Frame, Reading};

use super::drops_carry;
use super::logistic::Logistic;
use super::turns::{Turn, steady};
use super::twin::{DEGREES, Room, Twin, room};
use crate::xv11::Profile;

/// Turns of a window.
const WINDOW: usize = 2;
/// Minimum number of windows that can be halved.
const WINDOWS_MIN: usize = 4;
/// Minimum number of degrees of the room, or of packets with a distance, in a window.
const SHOWN_MIN: usize = 30;
/// Maximum number of compared turns, and number of emulated units.
const TURNS_MAX: usize = 240;
const UNITS: u64 = 2;
/// Steepest wall, as a part of the distance in a degree: on a steeper one a sensor that is turned a
/// little, as in the capture of 2.1, changes all distances.
const SLOPE: f64 = 0.012;
/// Neighbours on both sides that must belong to the room.
const AROUND: usize = 2;

/// Result of a group of figures.
#[derive(Clone, Debug, PartialEq)]
pub struct Told {
    /// Name of the group.
    pub group: &'static str,
    /// Part of the judged windows whose origin was found, percent. `None` if the group was not
    /// compared: one of the streams shows too little of it.
    pub accuracy: Option<f64>,
    /// Windows of the capture, and of the emulation, that show enough for a comparison.
    pub windows: [usize; 2],
    /// Whether the figures depend on the ring of teeth, which differs between real units.
    pub is_of_the_unit: bool,
    /// The figures, the one that tells most first.
    pub figures: Vec<Figure>,
}

impl Told {
    /// Highest accuracy that counts as chance, percent: 60, and with few windows three standard
    /// errors above 50.
    pub fn limit(&self) -> f64 {
        let variances = self.windows.map(|count| 0.25 / f64::max(count as f64, 1.0));
        let error = variances.into_iter().sum::<f64>().sqrt() / 2.0;
        f64::max(60.0, 50.0 + 300.0 * error)
    }
}

/// A figure of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// Its name.
    pub name: &'static str,
    /// Mean over the windows of the capture.
    pub real: f64,
    /// Mean over the windows of the emulation.
    pub emulated: f64,
}

/// Figures of a window; none of a window that shows too little.
type Figures = fn(&[Turn], &Room) -> Vec<f64>;

/// Groups with the names of their figures.
const GROUPS: [(&str, &[&str], Figures); 5] = [
    (
        "packets",
        &["dropped carries", "same strengths", "start bytes within"],
        packets,
    ),
    (
        "tooth speeds",
        &[
            "steps",
            "from turn to turn",
            "steps in a row",
            "seven teeth apart",
        ],
        tooth_speeds,
    ),
    (
        "distances",
        &["same again", "moved", "moved by 2 mm", "moved together"],
        distances,
    ),
    (
        "strengths",
        &["moved", "moved far", "same again", "moved together"],
        strengths,
    ),
    ("codes", &["0x21", "others on a wall"], codes),
];

/// Judges each group of figures of `bytes` against emulated units with `seed` and the seeds after
/// it. Firmware 2.1 has neither packets nor the speed of a tooth, so these groups are left out.
///
/// `None`: too few steady turns.
pub fn blind(bytes: &[u8], profile: Profile, seed: u64) -> Option<Vec<Told>> {
    let mut turns = steady(bytes);
    turns.truncate(TURNS_MAX);
    let count = turns.len() / WINDOW * WINDOW;
    turns.truncate(count);
    if count / WINDOW < WINDOWS_MIN {
        return None;
    }
    let twin = Twin::of(profile, &room(turns.iter()));
    let ours: Vec<Vec<Turn>> = (0..UNITS)
        .map(|unit| twin.turns(seed.wrapping_add(unit), count))
        .collect();
    Some(judged(&turns, &ours))
}

/// Judges each group of figures of the capture's `turns` against those of emulated units.
fn judged(turns: &[Turn], ours: &[Vec<Turn>]) -> Vec<Told> {
    let has_packets = turns.iter().any(|turn| !turn.packets.is_empty());
    let groups = GROUPS
        .iter()
        .filter(|(group, ..)| has_packets || !["packets", "tooth speeds"].contains(group));
    groups
        .map(|&(group, names, figures)| {
            let rows = |turns: &[Turn]| -> Vec<Vec<f64>> {
                let seen = room(turns.iter());
                let windows = turns.chunks_exact(WINDOW);
                let rows = windows.map(|window| figures(window, &seen));
                rows.filter(|row| !row.is_empty()).collect()
            };
            let real = rows(turns);
            let emulated: Vec<Vec<f64>> = ours.iter().flat_map(|turns| rows(turns)).collect();
            // Windows that one stream lacks are a difference that the others do not show.
            let wanted = turns.len() / WINDOW / 2;
            let is_shown = real.len() >= wanted.max(WINDOWS_MIN)
                && emulated.len() >= (wanted * ours.len()).max(WINDOWS_MIN);
            let (accuracy, figures) = match is_shown {
                true => {
                    let (accuracy, figures) = told(names, &real, &emulated);
                    (Some(accuracy), figures)
                }
                false => (None, Vec::new()),
            };
            Told {
                group,
                accuracy,
                windows: [real.len(), emulated.len()],
                is_of_the_unit: ["tooth speeds", "codes"].contains(&group),
                figures,
            }
        })
        .collect()
}

/// Accuracy of the classifier, percent, and the figures, the one that tells most first.
fn told(names: &[&'static str], real: &[Vec<f64>], ours: &[Vec<f64>]) -> (f64, Vec<Figure>) {
    let half = |rows: &[Vec<f64>], odd: usize| -> Vec<Vec<f64>> {
        rows.iter().skip(odd).step_by(2).cloned().collect()
    };
    let (mut hits, mut order) = (0.0, Vec::new());
    for odd in [0, 1] {
        let classifier = Logistic::trained(&half(real, odd), &half(ours, odd));
        let share = |rows: Vec<Vec<f64>>, is_real: bool| {
            let right = rows
                .iter()
                .filter(|row| (classifier.chance(row) > 0.5) == is_real);
            right.count() as f64 / rows.len().max(1) as f64
        };
        hits += share(half(real, 1 - odd), true) + share(half(ours, 1 - odd), false);
        order = classifier.heaviest_first();
    }
    let column = |rows: &[Vec<f64>], index: usize| -> f64 {
        mean(&rows.iter().map(|row| row[index]).collect::<Vec<_>>())
    };
    let figure = |index: usize| Figure {
        name: names[index],
        real: column(real, index),
        emulated: column(ours, index),
    };
    (100.0 * hits / 4.0, order.into_iter().map(figure).collect())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn deviation(values: &[f64]) -> f64 {
    let middle = mean(values);
    let squares: Vec<f64> = values
        .iter()
        .map(|value| (value - middle).powi(2))
        .collect();
    mean(&squares).sqrt()
}

/// Correlation of the values with those `lag` positions later.
fn alike(values: &[f64], lag: usize) -> f64 {
    let middle = mean(values);
    let pairs = values.iter().zip(values.iter().skip(lag));
    let sum: f64 = pairs.map(|(a, b)| (a - middle) * (b - middle)).sum();
    let own: f64 = values.iter().map(|a| (a - middle).powi(2)).sum();
    sum / own.max(1e-12)
}

/// Share of `values` for which `is` holds.
fn share<T>(values: &[T], is: impl Fn(&T) -> bool) -> f64 {
    values.iter().filter(|value| is(value)).count() as f64 / values.len().max(1) as f64
}

fn packets(window: &[Turn], _room: &Room) -> Vec<f64> {
    let packets: Vec<&Frame> = window.iter().flat_map(|turn| &turn.packets).collect();
    let of = |packet: &Frame| -> Vec<Option<u16>> {
        packet
            .readings()
            .into_iter()
            .map(|reading| match reading {
                Reading::Range { strength, .. } => Some(strength),
                Reading::Invalid { .. } => None,
            })
            .collect()
    };
    let strengths: Vec<Vec<Option<u16>>> = packets.iter().map(|packet| of(packet)).collect();
    let with_distance = strengths
        .iter()
        .filter(|four| four.iter().any(Option::is_some));
    if with_distance.count() < SHOWN_MIN {
        return Vec::new();
    }
    vec![
        share(&packets, |packet| drops_carry(packet)),
        share(&strengths, |four| {
            four.windows(2).any(|two| two[0] == two[1])
        }),
        share(&packets, |packet| packet.as_bytes()[1..].contains(&0xFA)),
    ]
}

fn tooth_speeds(window: &[Turn], _room: &Room) -> Vec<f64> {
    if window.iter().any(|turn| turn.speeds_rpm.len() < 2) {
        return Vec::new();
    }
    let teeth = window[0].speeds_rpm.len();
    let speeds: Vec<f64> = window
        .iter()
        .flat_map(|turn| turn.speeds_rpm.clone())
        .collect();
    let steps: Vec<f64> = speeds.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // The same tooth a turn later: the ring's unevenness cancels out.
    let later = speeds.iter().zip(speeds.iter().skip(teeth));
    let turned: Vec<f64> = later.map(|(before, after)| after - before).collect();
    vec![
        deviation(&steps),
        deviation(&turned),
        alike(&turned, 1),
        alike(&turned, 7),
    ]
}

/// Readings of the room in a window: by turn and degree, less the room's. `None` at edges, corners,
/// and where something moves.
fn of_room(window: &[Turn], room: &Room) -> Vec<Vec<Option<[f64; 2]>>> {
    let is_room = |turn: &Turn, degree: usize| match (turn.range(degree), room[degree]) {
        (Some((mm, _)), Some(spot)) => spot.is_at(mm),
        _ => false,
    };
    let of_turn = |turn: &Turn| {
        let of_degree = |degree: usize| {
            let around = (0..=2 * AROUND).map(|off| (degree + DEGREES + off - AROUND) % DEGREES);
            let is_plain = around.clone().all(|near| is_room(turn, near));
            let is_smooth = is_plain
                && around.into_iter().zip(0..2 * AROUND).all(|(near, _)| {
                    let [a, b] = [near, (near + 1) % DEGREES].map(|degree| room[degree]);
                    matches!((a, b), (Some(a), Some(b)) if (a.mm - b.mm).abs() < SLOPE * a.mm)
                });
            let ((mm, strength), spot) = (turn.range(degree)?, room[degree]?);
            let scale = spot.strength.max(1.0).sqrt();
            is_smooth.then(|| [mm - spot.mm, (strength - spot.strength) / scale])
        };
        (0..DEGREES).map(of_degree).collect()
    };
    window.iter().map(of_turn).collect()
}

/// Changes from the first turn of a window to the second, by degree.
fn changes(window: &[Turn], room: &Room, which: usize) -> Vec<Option<f64>> {
    let turns = of_room(window, room);
    let both = turns[0].iter().zip(&turns[1]);
    both.map(|(a, b)| Some(b.as_ref()?[which] - a.as_ref()?[which]))
        .collect()
}

/// Correlation of the changes of neighbouring degrees.
fn together(changes: &[Option<f64>]) -> f64 {
    let pairs = changes
        .windows(2)
        .filter_map(|two| Some((two[0]?, two[1]?)));
    let (mut sum, mut own) = (0.0, 0.0);
    for (a, b) in pairs {
        sum += a * b;
        own += (a * a + b * b) / 2.0;
    }
    sum / f64::max(own, 1e-12)
}

fn distances(window: &[Turn], room: &Room) -> Vec<f64> {
    let changes = changes(window, room, 0);
    let moved: Vec<f64> = changes.iter().flatten().copied().collect();
    if moved.len() < SHOWN_MIN {
        return Vec::new();
    }
    vec![
        share(&moved, |way| *way == 0.0),
        deviation(&moved),
        share(&moved, |way| way.abs() >= 2.0),
        together(&changes),
    ]
}

fn strengths(window: &[Turn], room: &Room) -> Vec<f64> {
    let changes = changes(window, room, 1);
    let moved: Vec<f64> = changes.iter().flatten().copied().collect();
    if moved.len() < SHOWN_MIN {
        return Vec::new();
    }
    vec![
        deviation(&moved),
        share(&moved, |way| way.abs() > 1.0),
        share(&moved, |way| *way == 0.0),
        together(&changes),
    ]
}

/// Skipped slots, and other codes in the midst of a wall.
fn codes(window: &[Turn], room: &Room) -> Vec<f64> {
    let mut all = Vec::new();
    let mut on_walls = Vec::new();
    for turn in window {
        let is_room = |near: usize| match (turn.range(near), room[near]) {
            (Some((mm, _)), Some(spot)) => spot.is_at(mm),
            _ => false,
        };
        let inner = room.iter().enumerate().take(DEGREES - AROUND).skip(AROUND);
        for (degree, spot) in inner {
            let code = match turn.readings[degree] {
                Reading::Invalid { code, .. } => Some(code),
                Reading::Range { .. } => None,
            };
            all.push(code);
            let near = [degree - 2, degree - 1, degree + 1, degree + 2];
            if spot.is_some() && near.into_iter().all(is_room) {
                on_walls.push(code);
            }
        }
    }
    if on_walls.len() < SHOWN_MIN {
        return Vec::new();
    }
    vec![
        share(&all, |code| *code == Some(0x21)),
        share(&on_walls, |code| code.is_some_and(|code| code != 0x21)),
    ]
}
