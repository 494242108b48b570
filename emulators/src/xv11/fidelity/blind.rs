//! A blind test: a plain classifier tries to tell windows of a real capture from windows of the
//! emulated sensor in the same room. Its accuracy is the figure: 50 % is chance.
//!
//! A window is two turns. Half of the windows train the classifier, the others are judged, and then
//! the other way round. Only what repeats is the room: something that moves in it, edges and
//! corners are left out of both streams.

use protocols::xv11::{Frame, Reading};

use super::drops_carry;
use super::logistic::Logistic;
use super::turns::{Turn, steady};
use super::twin::{DEGREES, Room, Twin, room};
use crate::xv11::Profile;

/// Turns of a window.
const WINDOW: usize = 2;
/// Fewest windows that can be halved.
const WINDOWS_MIN: usize = 4;
/// Most turns that are compared, and emulated units.
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
    /// Part of the judged windows whose origin was found, percent.
    pub accuracy: f64,
    /// Number of real windows that were judged.
    pub windows: usize,
    /// The figures, the one that tells most first.
    pub figures: Vec<Figure>,
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

/// Judges each group of figures of `bytes`. `None`: too few steady turns.
pub fn blind(bytes: &[u8], profile: Profile) -> Option<Vec<Told>> {
    let mut turns = steady(bytes);
    turns.truncate(TURNS_MAX);
    let count = turns.len() / WINDOW * WINDOW;
    turns.truncate(count);
    if count / WINDOW < WINDOWS_MIN {
        return None;
    }
    let seen = room(turns.iter());
    let twin = Twin::of(profile, &seen);
    let ours: Vec<(Vec<Turn>, Room)> = (1..=UNITS)
        .map(|seed| {
            let turns = twin.turns(seed, count);
            let seen = room(turns.iter());
            (turns, seen)
        })
        .collect();
    let groups = GROUPS.iter().filter_map(|(group, names, figures)| {
        let rows = |turns: &[Turn], seen: &Room| -> Vec<Vec<f64>> {
            let windows = turns.chunks_exact(WINDOW);
            windows.map(|window| figures(window, seen)).collect()
        };
        let real = rows(&turns, &seen);
        let ours: Vec<Vec<f64>> = ours
            .iter()
            .flat_map(|(turns, seen)| rows(turns, seen))
            .collect();
        // Firmware 2.1 has neither packets nor the speed of a tooth.
        let is_there = real.iter().chain(&ours).all(|row| !row.is_empty());
        is_there.then(|| told(group, names, &real, &ours))
    });
    Some(groups.collect())
}

fn told(group: &'static str, names: &[&'static str], real: &[Vec<f64>], ours: &[Vec<f64>]) -> Told {
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
    Told {
        group,
        accuracy: 100.0 * hits / 4.0,
        windows: real.len(),
        figures: order.into_iter().map(figure).collect(),
    }
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

/// Part of `values` that `is` holds for.
fn share<T>(values: &[T], is: impl Fn(&T) -> bool) -> f64 {
    values.iter().filter(|value| is(value)).count() as f64 / values.len().max(1) as f64
}

fn packets(window: &[Turn], _room: &Room) -> Vec<f64> {
    let packets: Vec<&Frame> = window.iter().flat_map(|turn| &turn.packets).collect();
    if packets.is_empty() {
        return Vec::new();
    }
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
    vec![
        share(&all, |code| *code == Some(0x21)),
        share(&on_walls, |code| code.is_some_and(|code| code != 0x21)),
    ]
}
