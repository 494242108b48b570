//! The PC program: orders from the page, turned into frames of the PC.
//!
//! ```text
//! gesture -> answer (based on the robot's reports) -> action -> PC -> PCUI bytes -> radio
//! ```
//!
//! The protocol with its timeouts and repetitions is in [`emulators::pc::Pc`]; this module edits
//! the list of waypoints. It does not use the robot's waypoint numbers: it always sends a complete
//! list with new numbers and links, so that no entry can refer to a removed waypoint (the fielded
//! program sent the old numbers, which crashed robots). An invalid gesture is refused with a
//! message, and nothing is sent.

pub mod fielded;

use emulators::pc::{Connection, Pc};
use protocols::pcui::message::WAYPOINTS_MAX;

pub use crate::robots::station::{Gesture, HAND_OFF, Hand};
use crate::scenario::Action;

/// The reason why a gesture has no effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// No connection.
    #[error("not connected to the robot")]
    NotConnected,
    /// The robot has not reported the size of its map yet, so no position is valid.
    #[error("the robot has not sent the size of its map yet")]
    NoMap,
    /// The position is outside the map.
    #[error("not on the map, which is {} mm x {} mm", .size_mm[0], .size_mm[1])]
    Outside {
        /// Size of the map.
        size_mm: [u16; 2],
    },
    /// A frame cannot contain more waypoints.
    #[error("one message holds at most {WAYPOINTS_MAX} waypoints")]
    Full,
    /// The waypoint is not where the operator saw it: the list has changed.
    #[error("the list of waypoints has changed meanwhile")]
    Changed,
}

/// The displayed list: the last sent one until the robot confirms it, then the robot's.
pub fn waypoints(pc: &Pc) -> Vec<[i16; 2]> {
    match (pc.unconfirmed_waypoints(), &pc.record().waypoints) {
        (Some(list), _) => list.to_vec(),
        (None, Some((_, list))) => list.iter().map(|waypoint| waypoint.position_mm).collect(),
        (None, None) => Vec::new(),
    }
}

/// The PC's action for `gesture`.
///
/// # Errors
/// If the gesture is not valid now.
pub fn answer(pc: &Pc, gesture: Gesture) -> Result<Action, Refusal> {
    let action = match gesture {
        Gesture::Connect => return Ok(Action::Connect),
        Gesture::Disconnect => return Ok(Action::Disconnect),
        Gesture::Mode(mode) => Action::Mode(mode),
        Gesture::Drive(set_point) => Action::Drive(set_point),
        Gesture::Clear => list_of(&[]),
        Gesture::Add { .. } | Gesture::Move { .. } | Gesture::Delete { .. } => {
            list_of(&edited(pc, gesture)?)
        }
    };
    match pc.connection() {
        Connection::Connected(_) => Ok(action),
        Connection::Closed | Connection::Opening => Err(Refusal::NotConnected),
    }
}

fn list_of(list: &[[i16; 2]]) -> Action {
    let metres = |mm: &[i16; 2]| mm.map(|mm| f64::from(mm) / 1000.0);
    Action::WaypointsM(list.iter().map(metres).collect())
}

fn edited(pc: &Pc, gesture: Gesture) -> Result<Vec<[i16; 2]>, Refusal> {
    let mut list = waypoints(pc);
    match gesture {
        Gesture::Add { .. } if list.len() >= WAYPOINTS_MAX => return Err(Refusal::Full),
        Gesture::Add { at } => list.push(on_map(pc, at)?),
        Gesture::Move { index, from, to } => {
            let to = on_map(pc, to)?;
            *seen(&mut list, index, from)? = to;
        }
        Gesture::Delete { index, at } => {
            seen(&mut list, index, at)?;
            list.remove(index);
        }
        _ => {}
    }
    Ok(list)
}

/// The waypoint `index`, if it is where the operator saw it.
fn seen(list: &mut [[i16; 2]], index: usize, at: [i32; 2]) -> Result<&mut [i16; 2], Refusal> {
    let waypoint = list.get_mut(index).ok_or(Refusal::Changed)?;
    if waypoint.map(i32::from) == at {
        Ok(waypoint)
    } else {
        Err(Refusal::Changed)
    }
}

/// The position, if it is on the map.
fn on_map(pc: &Pc, at: [i32; 2]) -> Result<[i16; 2], Refusal> {
    let (_, properties) = pc.record().map_properties.ok_or(Refusal::NoMap)?;
    if pc.map().is_none() {
        return Err(Refusal::NoMap);
    }
    let size_mm = properties.size_mm;
    let [x, y] = [0, 1].map(|axis: usize| {
        let within = (0..i32::from(size_mm[axis])).contains(&at[axis]);
        i16::try_from(at[axis]).ok().filter(|_| within)
    });
    match (x, y) {
        (Some(x), Some(y)) => Ok([x, y]),
        _ => Err(Refusal::Outside { size_mm }),
    }
}

#[cfg(test)]
mod tests;
