//! Telemetry logs of MAVLink ground stations (.tlog): each packet after its time.
//!
//! ```text
//! | microseconds since 1970, 8 bytes, high first | FE or FD .. the packet |
//! ```
//!
//! The log contains both directions without distinguishing them.

use super::Look;
use super::imported::{ImportError, Imported, Options};
use crate::Kind;

/// Accepted times: 2001 to 2100.
const TIMES: core::ops::Range<u64> = 978_000_000_000_000..4_102_000_000_000_000;

/// The time and the packet at the beginning of `bytes`, with the total length.
fn entry(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let (time, packet) = bytes.split_first_chunk::<8>()?;
    let micros = u64::from_be_bytes(*time);
    let len = match *packet {
        [0xFE, len, ..] => usize::from(len) + 8,
        // With a signature of 13 bytes.
        [0xFD, len, flags, ..] => usize::from(len) + 12 + 13 * usize::from(flags & 1),
        _ => return None,
    };
    let packet = packet.get(..len)?;
    TIMES.contains(&micros).then_some((micros, packet))
}

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let (_, first) = entry(bytes)?;
    entry(&bytes[8 + first.len()..]).map(|_| Look::Surely)
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    out.note("a telemetry log has no directions: all bytes count as sent by the device");
    let link = out.link(&options.link, options);
    let mut at = 0;
    while at < bytes.len() {
        let Some((micros, packet)) = entry(&bytes[at..]) else {
            let rest = bytes.len() - at;
            if rest > 8 + 280 {
                return Err(ImportError::at_byte(
                    at,
                    "expected a time and a MAVLink packet: the log is damaged here",
                ));
            }
            out.note(format!(
                "the log was cut: {rest} bytes at its end are not a complete packet"
            ));
            break;
        };
        let nanos = micros.saturating_mul(1_000);
        out.push(link, nanos, options.direction, Kind::Data, packet);
        at += 8 + packet.len();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};

    /// A heartbeat of MAVLink 1 and an empty packet of MAVLink 2.
    #[test]
    fn packets_have_their_times_and_the_times_are_no_bytes_of_the_line() {
        let first = [&[0xFE, 9, 0, 1, 1, 0][..], &[0; 9], &[0x12, 0x34]].concat();
        let second = [0xFD, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0x56, 0x78];
        let time = |micros: u64| micros.to_be_bytes();
        let file = [
            &time(1_795_247_928_000_001)[..],
            &first,
            &time(1_795_247_928_500_000),
            &second,
            &[1, 2, 3],
        ]
        .concat();
        assert_eq!(Format::detect(&file), Some(Format::Tlog));
        let found = read_format(&file, Format::Tlog, &Options::default()).expect("sound");
        let times: Vec<u64> = found
            .records()
            .iter()
            .map(|one| one.at.as_nanos())
            .collect();
        assert_eq!(
            times,
            [1_795_247_928_000_001_000, 1_795_247_928_500_000_000]
        );
        assert_eq!(&found.records()[0].bytes[..], first);
        assert_eq!(&found.records()[1].bytes[..], second);
        assert!(
            found
                .notes
                .iter()
                .any(|note| note.contains("3 bytes at its end"))
        );
    }

    /// MAVLink 1 has eight bytes around its payload, MAVLink 2 twelve, and 13 more if it is signed.
    #[test]
    fn a_packet_has_the_length_of_its_version() {
        let len = |head: &[u8]| {
            let time = 1_795_247_928_000_001_u64.to_be_bytes();
            let bytes = [&time[..], head, &[0; 99]].concat();
            entry(&bytes).map(|(_, packet)| packet.len())
        };
        assert_eq!(len(&[0xFE, 9]), Some(17));
        assert_eq!(len(&[0xFD, 9, 0]), Some(21));
        assert_eq!(len(&[0xFD, 9, 1]), Some(34));
        assert_eq!(len(&[0xFD, 9, 2]), Some(21));
        assert_eq!(len(&[0xFC, 9, 0]), None);
        let at = |micros: u64| {
            entry(&[&micros.to_be_bytes()[..], &[0xFE, 0], &[0; 6]].concat()).is_some()
        };
        // Times are from the year 2000 to 2099; a packet needs all of its bytes.
        assert_eq!(
            [977_999_999_999_999, 978_000_000_000_000].map(at),
            [false, true]
        );
        assert_eq!(
            [4_101_999_999_999_999, 4_102_000_000_000_000].map(at),
            [true, false]
        );
        assert!(
            entry(&[&978_000_000_000_000_u64.to_be_bytes()[..], &[0xFE, 0, 0]].concat()).is_none()
        );
    }

    /// Up to 288 bytes at the end are the rest of a cut packet and its time.
    #[test]
    fn the_end_of_a_log_may_be_cut() {
        let time = 1_795_247_928_000_001_u64.to_be_bytes();
        let packet = [&time[..], &[0xFE, 0], &[0; 6]].concat();
        let of = |rest: usize| {
            let bytes = [&packet[..], &vec![7; rest]].concat();
            let mut out = Imported::new();
            let found = read(&bytes, &Options::default(), &mut out);
            found
                .map(|()| out.notes.len())
                .map_err(|error| error.offset)
        };
        assert_eq!([0, 1, 288, 289].map(of), [Ok(1), Ok(2), Ok(2), Err(16)]);
    }
}
