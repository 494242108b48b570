//! Commands to the base, decoded from the bytes.

use emulators::avr_base::AvrBase;
use protocols::avr::registers::{SPEED_LEFT_TO, SPEED_RIGHT_TO};
use protocols::avr::{self, ChecksumOrder};
use protocols::{Candidate, Format as _};

use super::{SET_POINT_MAX, order_of};
use crate::rig::Rig;
use crate::robots::{Command, Dialect};

pub(super) fn dialect(rig: &Rig) -> Option<Dialect> {
    let base = rig.device::<AvrBase>("base")?;
    let command = match order_of(base.profile()) {
        ChecksumOrder::LowFirst => |bytes: &[u8]| command(bytes, ChecksumOrder::LowFirst),
        ChecksumOrder::HighFirst => |bytes: &[u8]| command(bytes, ChecksumOrder::HighFirst),
    };
    Some(Dialect {
        link: "base",
        frame_max: avr::FRAME_MAX,
        command,
    })
}

/// The set-points in the last frame of `bytes`.
fn command(bytes: &[u8], order: ChecksumOrder) -> Option<Command> {
    let format = avr::Bus { order };
    let starts = (0..bytes.len()).filter(|&at| bytes[at] == avr::START);
    let mut ends = starts.map(|at| &bytes[at..]);
    // Compare the length first: a checksum for each start byte would cover all bytes behind it.
    let has_its_length = |frame: &[u8]| {
        let control = frame.get(2);
        control.is_some_and(|&control| avr::frame_len(control) == frame.len())
    };
    let is_whole = |frame: &&[u8]| {
        has_its_length(frame) && format.judge(frame) == Candidate::Complete(frame.len())
    };
    let frame = format.frame(ends.find(is_whole)?);
    let told = |address: u8| {
        let offset = address.checked_sub(frame.register())?;
        let value = frame.data().get(usize::from(offset))?.cast_signed();
        Some(f64::from(
            i16::from(value).clamp(-SET_POINT_MAX, SET_POINT_MAX),
        ))
    };
    let command = [SPEED_LEFT_TO, SPEED_RIGHT_TO].map(told);
    (command != [None; 2]).then(|| command.to_vec())
}
