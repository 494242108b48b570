//! Express scan: 32 samples in 84 bytes.

use super::TURN_Q6;

/// Bytes of a capsule.
pub const CAPSULE_LEN: usize = 84;
/// Samples in a capsule.
pub const CAPSULE_SAMPLES: usize = 32;

/// Bytes of a cabin, which holds two samples.
const CABIN_LEN: usize = 5;
/// High nibbles of the first two bytes.
const SYNC: [u8; 2] = [0xA0, 0x50];
/// 2048ths of a degree in a turn.
const TURN_Q11: i32 = (TURN_Q6 as i32) << 5;

/// A sample as a cabin holds it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CapsuleSample {
    /// Millimetres, 14 bits; 0 is no measurement.
    pub distance_mm: u16,
    /// Angle of the sample behind the even division of the turn, eighths of a degree, 6 bits. LR001
    /// calls it signed; the vendor's code and this one take it without sign.
    pub dtheta_q3: u8,
}

/// A sample with its angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// 2048ths of a degree, clockwise from ahead, below 360 degrees: exact, without rounding.
    pub angle_q11: u32,
    /// Millimetres; 0 is no measurement.
    pub distance_mm: u16,
}

impl Sample {
    /// Angle in degrees, clockwise from ahead.
    pub fn angle_deg(self) -> f32 {
        #[expect(clippy::cast_precision_loss, reason = "20 bits are exact in an f32")]
        let angle = self.angle_q11 as f32;
        angle / 2048.0
    }
}

/// A capsule whose sync nibbles and checksum hold. Keeps every bit.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Capsule([u8; CAPSULE_LEN]);

impl Capsule {
    /// The capsule of these parts: `first` marks the first one of a scan. The angle is cut to 15
    /// bits, distances to 14 and offsets to 6.
    pub fn new(
        first: bool,
        start_angle_q6: u16,
        samples: &[CapsuleSample; CAPSULE_SAMPLES],
    ) -> Self {
        let mut bytes = [0; CAPSULE_LEN];
        let angle = start_angle_q6 & 0x7FFF | u16::from(first) << 15;
        bytes[2..4].copy_from_slice(&angle.to_le_bytes());
        let cabins = bytes[4..].chunks_exact_mut(CABIN_LEN);
        for (cabin, pair) in cabins.zip(samples.chunks_exact(2)) {
            let word = |sample: CapsuleSample| {
                let dtheta = u16::from(sample.dtheta_q3 >> 4 & 0b11);
                (sample.distance_mm << 2 | dtheta).to_le_bytes()
            };
            cabin[..2].copy_from_slice(&word(pair[0]));
            cabin[2..4].copy_from_slice(&word(pair[1]));
            cabin[4] = pair[0].dtheta_q3 & 0x0F | pair[1].dtheta_q3 << 4;
        }
        let sum = checksum(&bytes);
        bytes[0] = SYNC[0] | sum & 0x0F;
        bytes[1] = SYNC[1] | sum >> 4;
        Self(bytes)
    }

    /// Makes it from bytes that were already judged.
    pub(super) fn from_judged(bytes: &[u8]) -> Self {
        let mut capsule = Self([0; CAPSULE_LEN]);
        capsule.0.copy_from_slice(&bytes[..CAPSULE_LEN]);
        capsule
    }

    /// Whether the capsule is the first of a scan: earlier capsules do not belong to the scan.
    pub const fn is_first(&self) -> bool {
        self.0[3] & 0x80 != 0
    }

    /// Angle of the first sample before its offset is taken off, 64ths of a degree.
    pub const fn start_angle_q6(&self) -> u16 {
        u16::from_le_bytes([self.0[2], self.0[3]]) & 0x7FFF
    }

    /// The samples without their angles.
    pub fn raw_samples(&self) -> [CapsuleSample; CAPSULE_SAMPLES] {
        let mut samples = [CapsuleSample::default(); CAPSULE_SAMPLES];
        let cabins = self.0[4..].chunks_exact(CABIN_LEN);
        for (pair, cabin) in samples.chunks_exact_mut(2).zip(cabins) {
            pair[0] = sample([cabin[0], cabin[1]], cabin[4] & 0x0F);
            pair[1] = sample([cabin[2], cabin[3]], cabin[4] >> 4);
        }
        samples
    }

    /// The samples with their angles. `next` is the capsule behind this one; its start angle gives
    /// the rotation of the head in between. Sample k (from 0, as in the vendor's code) lies at
    /// `start + k / 32 of the way - dtheta`.
    pub fn samples(&self, next: &Self) -> [Sample; CAPSULE_SAMPLES] {
        let start = i32::from(self.start_angle_q6());
        let turn = i32::from(TURN_Q6);
        let way = (i32::from(next.start_angle_q6()) - start).rem_euclid(turn);
        let mut samples = [Sample {
            angle_q11: 0,
            distance_mm: 0,
        }; CAPSULE_SAMPLES];
        for ((k, raw), sample) in (0..).zip(self.raw_samples()).zip(&mut samples) {
            let angle = (start << 5) + way * k - (i32::from(raw.dtheta_q3) << 8);
            sample.angle_q11 = angle.rem_euclid(TURN_Q11).cast_unsigned();
            sample.distance_mm = raw.distance_mm;
        }
        samples
    }

    /// The capsule as on the wire.
    pub const fn as_bytes(&self) -> &[u8; CAPSULE_LEN] {
        &self.0
    }
}

impl core::fmt::Debug for Capsule {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "rplidar::Capsule({:02X?})", self.0)
    }
}

fn sample(word: [u8; 2], dtheta_low: u8) -> CapsuleSample {
    let word = u16::from_le_bytes(word);
    let dtheta_high = word.to_le_bytes()[0] & 0b11;
    CapsuleSample {
        distance_mm: word >> 2,
        dtheta_q3: dtheta_high << 4 | dtheta_low,
    }
}

/// Exclusive or of all bytes behind the first two.
pub(super) fn checksum(bytes: &[u8; CAPSULE_LEN]) -> u8 {
    bytes[2..].iter().fold(0, |sum, byte| sum ^ byte)
}

/// Whether a capsule may begin with these bytes, as far as they are there.
pub(super) fn may_begin(bytes: &[u8]) -> bool {
    bytes
        .iter()
        .zip(SYNC)
        .all(|(byte, sync)| byte & 0xF0 == sync)
}

/// The checksum in a capsule, from the low nibbles of its first two bytes.
pub(super) const fn found_checksum(first: u8, second: u8) -> u8 {
    first & 0x0F | second << 4
}
