/// One reading as sent: distance or error code, flags, strength.
///
/// ```text
/// | b0 distance LSB or error code | b1 invalid(7) weak(6) distance MSB(5..0) | strength u16 LE |
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawReading(pub [u8; 4]);

const INVALID: u8 = 0x80;
const WEAK: u8 = 0x40;

/// Largest distance that fits the 14 bits of the wire, in mm.
const DISTANCE_MAX_MM: u16 = 0x3FFF;

/// Meaning of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// The beam returned a distance.
    Range {
        /// Distance in millimetres, 0 to 16383.
        distance_mm: u16,
        /// Strength of the return, sensor units: about 1.0e8 / d^2 on a light wall.
        strength: u16,
        /// The strength warning: the return is weaker than it should be for this distance.
        weak: bool,
    },
    /// There is no distance.
    Invalid {
        /// Error code; see [`CODES`](Self::CODES).
        code: u8,
        /// Copied from the previous reading for some codes, else zero.
        strength: u16,
    },
}

impl Reading {
    /// Error codes seen in real captures, with the meaning inferred from where they occur.
    pub const CODES: [(u8, &'static str); 10] = [
        (0x02, "dot shape, double dot"),
        (0x03, "dot shape, too wide"),
        (0x06, "dot shape, both"),
        (0x21, "slot skipped at an encoder tooth"),
        (0x22, "waiting for the encoder, too slow"),
        (0x23, "encoder related, firmware 2.1 only"),
        (0x25, "dot too dim"),
        (0x35, "no dot"),
        (0x50, "resynchronised after a late tooth"),
        (0x52, "encoder lost or stalled"),
    ];
}

impl From<RawReading> for Reading {
    fn from(RawReading([b0, b1, b2, b3]): RawReading) -> Self {
        let strength = u16::from_le_bytes([b2, b3]);
        if b1 & INVALID != 0 {
            return Self::Invalid { code: b0, strength };
        }
        let distance_mm = u16::from_le_bytes([b0, b1 & !(INVALID | WEAK)]);
        Self::Range {
            distance_mm,
            strength,
            weak: b1 & WEAK != 0,
        }
    }
}

impl From<Reading> for RawReading {
    /// Distances beyond 16383 mm are sent as 16383.
    fn from(reading: Reading) -> Self {
        match reading {
            Reading::Range {
                distance_mm,
                strength,
                weak,
            } => {
                let [b0, b1] = distance_mm.min(DISTANCE_MAX_MM).to_le_bytes();
                let [b2, b3] = strength.to_le_bytes();
                Self([b0, if weak { b1 | WEAK } else { b1 }, b2, b3])
            }
            Reading::Invalid { code, strength } => {
                let [b2, b3] = strength.to_le_bytes();
                Self([code, INVALID, b2, b3])
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From golden packets of the 2.4 capture: a weak reading at 271 mm, a skipped slot that
    /// carries strength 466, and no dot.
    #[test]
    fn flags_codes_and_carried_strength_are_told_apart() {
        let weak = Reading::from(RawReading([0x0F, 0x41, 0x50, 0x00]));
        assert_eq!(
            weak,
            Reading::Range {
                distance_mm: 271,
                strength: 80,
                weak: true
            }
        );
        let skipped = Reading::from(RawReading([0x21, 0x80, 0xD2, 0x01]));
        assert_eq!(
            skipped,
            Reading::Invalid {
                code: 0x21,
                strength: 466
            }
        );
        let no_dot = Reading::from(RawReading([0x35, 0x80, 0x00, 0x00]));
        assert_eq!(
            no_dot,
            Reading::Invalid {
                code: 0x35,
                strength: 0
            }
        );
    }

    /// 271 is 010F, the weak bit makes it 410F; 16,383 is 3FFF, and so is everything beyond.
    #[test]
    fn a_reading_is_written_by_hand() {
        let bytes = |distance_mm, weak| {
            let strength = 80;
            RawReading::from(Reading::Range {
                distance_mm,
                strength,
                weak,
            })
            .0
        };
        assert_eq!(bytes(271, true), [0x0F, 0x41, 0x50, 0x00]);
        assert_eq!(bytes(271, false), [0x0F, 0x01, 0x50, 0x00]);
        assert_eq!(bytes(16_384, true), [0xFF, 0x7F, 0x50, 0x00]);
        assert_eq!(bytes(16_383, false), [0xFF, 0x3F, 0x50, 0x00]);
    }
}
