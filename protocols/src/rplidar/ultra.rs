//! Scan of the kind 0x84: 96 samples in 132 bytes.
//!
//! ```text
//! | A, xor low | 5, xor high | angle q6 u15, S(15) | 32 cabins of 4 bytes |
//! cabin: second(31..22) first(21..12) major(11..0)
//! ```
//!
//! A cabin holds three samples: `major` in a scale that grows coarser with the distance, and two
//! differences in the same scale. The first difference counts from the cabin's own major, the
//! second from the next cabin's, so the last one needs the next capsule. Layout and geometry are
//! those of the decoder in the vendor's public SDK (`handler_capsules.cpp`).

use super::TURN_Q6;
use super::capsule::Sample;

/// Bytes of a capsule of the kind 0x84.
pub const ULTRA_LEN: usize = 132;
/// Samples in it.
pub const ULTRA_SAMPLES: usize = 96;

/// Bytes of a cabin, which holds three samples.
const CABIN_LEN: usize = 4;
/// High nibbles of the first two bytes.
const SYNC: [u8; 2] = [0xA0, 0x50];
/// 2048ths of a degree in a turn.
const TURN_Q11: i64 = (TURN_Q6 as i64) << 5;
/// Steps of the scale: the least distance in millimetres, its coded value, and how many bits
/// coarser the distances from there on are.
const SCALE: [(u32, u32, u32); 5] = [
    (1 << 14, 3_328, 4),
    (1 << 12, 1_792, 3),
    (1 << 11, 1_280, 2),
    (1 << 9, 512, 1),
    (0, 0, 0),
];
/// Largest coded distance: 12 bits.
const MAJOR_MAX: u32 = 0xFFF;
/// Differences that mean "no measurement"; this encoder uses the first of them.
const NOTHING: [i32; 2] = [-512, 511];

/// A capsule of the kind 0x84 whose sync nibbles and checksum hold. Keeps every bit.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct UltraCapsule([u8; ULTRA_LEN]);

impl UltraCapsule {
    /// The capsule of these distances, millimetres, 0 for no measurement; `next_mm` is the first
    /// sample of the capsule behind it. `first` marks the first capsule of a scan, and the angle is
    /// cut to 15 bits.
    ///
    /// A sample too far from its reference sample counts as no measurement.
    pub fn new(
        first: bool,
        start_angle_q6: u16,
        samples_mm: &[u16; ULTRA_SAMPLES],
        next_mm: u16,
    ) -> Self {
        let mut bytes = [0; ULTRA_LEN];
        let angle = start_angle_q6 & 0x7FFF | u16::from(first) << 15;
        bytes[2..4].copy_from_slice(&angle.to_le_bytes());
        let triples = samples_mm.chunks_exact(3);
        let behind = samples_mm.iter().skip(3).step_by(3).chain([&next_mm]);
        let cabins = bytes[4..].chunks_exact_mut(CABIN_LEN);
        for ((cabin, triple), &behind) in cabins.zip(triples).zip(behind) {
            let (major, next) = (encoded(triple[0]), encoded(behind));
            let bases = Bases::of(major, next);
            let first = difference(triple[1], bases.first);
            let second = difference(triple[2], bases.second);
            let word = major | first << 12 | second << 22;
            cabin.copy_from_slice(&word.to_le_bytes());
        }
        let sum = checksum(&bytes);
        bytes[0] = SYNC[0] | sum & 0x0F;
        bytes[1] = SYNC[1] | sum >> 4;
        Self(bytes)
    }

    /// Makes it from bytes that were already judged.
    pub(super) fn from_judged(bytes: &[u8]) -> Self {
        let mut capsule = Self([0; ULTRA_LEN]);
        capsule.0.copy_from_slice(&bytes[..ULTRA_LEN]);
        capsule
    }

    /// Whether the capsule is the first of a scan: earlier capsules do not belong to the scan.
    pub const fn is_first(&self) -> bool {
        self.0[3] & 0x80 != 0
    }

    /// Angle of the head at the first sample, 64ths of a degree.
    pub const fn start_angle_q6(&self) -> u16 {
        u16::from_le_bytes([self.0[2], self.0[3]]) & 0x7FFF
    }

    /// The 32 words of the cabins.
    fn words(&self) -> impl Iterator<Item = u32> + '_ {
        let cabins = self.0[4..].chunks_exact(CABIN_LEN);
        cabins.map(|cabin| u32::from_le_bytes([cabin[0], cabin[1], cabin[2], cabin[3]]))
    }

    /// The first distance of each three, millimetres: those that need no other sample.
    pub fn majors_mm(&self) -> impl Iterator<Item = u16> + '_ {
        self.words().map(|word| whole(decoded(word & MAJOR_MAX).0))
    }

    /// The samples with their angles: `next` is the capsule behind this one. The head has turned
    /// evenly between both; where a sample lies follows from its distance, see [`lead_q11`].
    pub fn samples(&self, next: &Self) -> [Sample; ULTRA_SAMPLES] {
        let start = i64::from(self.start_angle_q6());
        let way = (i64::from(next.start_angle_q6()) - start).rem_euclid(i64::from(TURN_Q6));
        let mut samples = [Sample {
            angle_q11: 0,
            distance_mm: 0,
        }; ULTRA_SAMPLES];
        let behind = self.words().skip(1).chain(next.words().take(1));
        let triples = samples.chunks_exact_mut(3);
        for ((word, behind), triple) in self.words().zip(behind).zip(triples) {
            let major = word & MAJOR_MAX;
            let bases = Bases::of(major, behind & MAJOR_MAX);
            triple[0].distance_mm = whole(decoded(major).0);
            triple[1].distance_mm = told(signed(word >> 12), bases.first);
            triple[2].distance_mm = told(signed(word >> 22), bases.second);
        }
        for (k, sample) in (0..).zip(&mut samples) {
            // 64ths of a degree times 32 are 2048ths; of the way k 96ths.
            let head = (start << 5) + way * k / 3;
            let angle = head - i64::from(lead_q11(sample.distance_mm));
            let angle = angle.rem_euclid(TURN_Q11);
            sample.angle_q11 = u32::try_from(angle).expect("below a turn");
        }
        samples
    }

    /// The capsule as on the wire.
    pub const fn as_bytes(&self) -> &[u8; ULTRA_LEN] {
        &self.0
    }
}

impl core::fmt::Debug for UltraCapsule {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "rplidar::UltraCapsule({:02X?})", self.0)
    }
}

/// Angle by which the head is ahead of an object at this distance, 2048ths of a degree.
///
/// The beam leaves 24.01 mm beside the axis and looks 8 degrees back, so the angle is 8 degrees
/// less the arcsine of 24.01 mm by the distance. The vendor's decoder takes two terms of it, and
/// 7.5 degrees below 50 mm and without a measurement. Nearer than 172 mm the angle is negative.
pub fn lead_q11(distance_mm: u16) -> i32 {
    let distance = u64::from(distance_mm);
    if distance < 50 {
        return 15_360;
    }
    // 24.0139 mm in 2048ths of a degree, and a sixth of its cube.
    let near = 2_817_795 / distance + 270_833_000 / (distance * distance * distance);
    16_384 - i32::try_from(near).unwrap_or(i32::MAX / 2)
}

/// Base and resolution of the two differences of a cabin.
struct Bases {
    first: (u32, u32),
    second: (u32, u32),
}

impl Bases {
    /// Bases of a cabin with this major, and the next one's. Without a measurement in the first,
    /// the second serves for both.
    fn of(major: u32, next: u32) -> Self {
        let (own, second) = (decoded(major), decoded(next));
        let first = if own.0 == 0 && second.0 != 0 {
            second
        } else {
            own
        };
        Self { first, second }
    }
}

/// The coded value of a distance: the nearest one below.
fn encoded(distance_mm: u16) -> u32 {
    let mm = u32::from(distance_mm);
    let step = SCALE.iter().find(|(from, ..)| mm >= *from);
    let &(from, code, bits) = step.expect("the last step begins at 0");
    (code + ((mm - from) >> bits)).min(MAJOR_MAX)
}

/// The distance of a coded value, and the number of bits lost by its scale.
fn decoded(major: u32) -> (u32, u32) {
    let step = SCALE.iter().find(|(_, code, _)| major >= *code);
    let &(from, code, bits) = step.expect("the last step begins at 0");
    (from + ((major - code) << bits), bits)
}

/// The ten bits that hold a distance as a difference.
fn difference(distance_mm: u16, (base, bits): (u32, u32)) -> u32 {
    let difference = (i32::from(distance_mm) - base.cast_signed()) >> bits;
    let fits = distance_mm != 0 && (NOTHING[0] + 1..NOTHING[1]).contains(&difference);
    let difference = if fits { difference } else { NOTHING[0] };
    difference.cast_unsigned() & 0x3FF
}

/// Ten bits with sign.
const fn signed(bits: u32) -> i32 {
    (bits << 22).cast_signed() >> 22
}

/// The distance from a difference.
fn told(difference: i32, (base, bits): (u32, u32)) -> u16 {
    if NOTHING.contains(&difference) {
        return 0;
    }
    let distance = base.cast_signed() + (difference << bits);
    whole(distance.max(0).cast_unsigned())
}

/// Distances of the scale go up to 28,656 mm, differences add at most 8,176.
fn whole(distance_mm: u32) -> u16 {
    u16::try_from(distance_mm).unwrap_or(u16::MAX)
}

/// Exclusive or of all bytes behind the first two.
pub(super) fn checksum(bytes: &[u8; ULTRA_LEN]) -> u8 {
    bytes[2..].iter().fold(0, |sum, byte| sum ^ byte)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand, from the constants of `sl_lidar_cmd.h`: 511 is itself, from 512 on every second,
    /// from 2048 every fourth, from 4096 every eighth, from 16384 every sixteenth.
    #[test]
    fn the_scale_grows_coarser_with_the_distance() {
        let both = |mm| (encoded(mm), decoded(encoded(mm)).0);
        assert_eq!(both(0), (0, 0));
        assert_eq!(both(511), (511, 511));
        assert_eq!(both(513), (512, 512));
        assert_eq!(both(2_047), (1_279, 2_046));
        assert_eq!(both(2_051), (1_280, 2_048));
        assert_eq!(both(4_096), (1_792, 4_096));
        assert_eq!(both(11_999), (2_779, 11_992));
        assert_eq!(both(16_400), (3_329, 16_400));
        assert_eq!(both(u16::MAX), (4_095, 28_656));
    }

    /// The vendor's formula in floating point: 8 degrees less asin(24.0139 / d), whose sine is
    /// cut behind the third power.
    #[test]
    fn the_lead_is_the_vendors() {
        for mm in [50_u16, 75, 100, 500, 1_000, 3_000, 12_000] {
            let part = 98_361.0 / 64.0 / (4.0 * f64::from(mm)) / 16.0;
            let lead = 8.0 - (part + part * part * part / 6.0).to_degrees();
            let found = f64::from(lead_q11(mm)) / 2_048.0;
            assert!((found - lead).abs() < 0.01, "{mm}: {found} {lead}");
        }
        assert_eq!([lead_q11(0), lead_q11(49)], [7 * 2_048 + 1_024; 2]);
    }

    /// Distances of 100, 90 and 2000 mm, then 3000 mm: the major value is 100, the first difference
    /// -10, and the second, from 3000 mm (coded 1518) in steps of four, -250.
    #[test]
    fn a_cabin_is_laid_out_by_hand() {
        let mut samples = [3_000; ULTRA_SAMPLES];
        samples[..3].copy_from_slice(&[100, 90, 2_000]);
        let capsule = UltraCapsule::new(true, 640, &samples, 3_000);
        let word = 100 | (1_014 << 12) | (774_u32 << 22);
        assert_eq!(capsule.as_bytes()[4..8], word.to_le_bytes());
        // The 31 others are EE 05 00 00: 64 ^ 60 ^ BF ^ C1 ^ 80 ^ 82 ^ EE ^ 05 is 93.
        assert_eq!(capsule.as_bytes()[..4], [0xA3, 0x59, 0x80, 0x82]);
        assert!(capsule.is_first());
        let next = UltraCapsule::new(false, 640 + 96 * 64, &[3_000; ULTRA_SAMPLES], 0);
        let told = capsule.samples(&next);
        let distances = [0, 1, 2, 3, 95].map(|index| told[index].distance_mm);
        assert_eq!(distances, [100, 90, 2_000, 3_000, 3_000]);
        // A degree a sample from 10 degrees on, 3 m: 8 - 0.4587 behind.
        let angle = |index: usize| f64::from(told[index].angle_q11) / 2_048.0;
        let expected = 10.0 + 60.0 - 7.541_3;
        assert!((angle(60) - expected).abs() < 0.01, "{}", angle(60));
    }

    /// A difference of ten bits cannot hold a wall of 3 m before one of 12 m, so one sample at each
    /// edge is lost. A first sample without measurement takes the next one's distance, because a
    /// difference could not hold the step from 0 to 3 m either.
    #[test]
    fn what_a_difference_cannot_hold_is_no_measurement() {
        let mut samples = [3_000; ULTRA_SAMPLES];
        samples[1] = 12_000;
        samples[2] = 0;
        samples[3] = 0;
        let capsule = UltraCapsule::new(false, 0, &samples, 3_000);
        let told = capsule.samples(&capsule);
        let distances = [0, 1, 2, 3, 4, 5].map(|index| told[index].distance_mm);
        assert_eq!(distances, [3_000, 0, 0, 0, 3_000, 3_000]);
    }
}
