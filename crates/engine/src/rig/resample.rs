//! A receiver whose rate or coding differs from the sender's: it samples each bit where it expects
//! the middle of the bit.

use core::time::Duration;

use protocols::{Instant, LineConfig, Parity};

use super::line::passage::{Mark, MarkDamage};

/// Rebuilds the wave form of the sent bytes and samples it at the receiver's rate.
///
/// The unit of time makes every edge and every sampling point a whole number: a sender's bit has
/// `2 * receiver.baud` units and a receiver's bit `2 * sender.baud`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Resampler {
    /// Levels not yet sampled, one per bit of the sender.
    bits: Vec<bool>,
    /// Units of `bits[0]` that the receiver has already passed.
    phase: u64,
    /// End of the last bit, and the idle time that ends a character.
    end: Option<(Instant, Duration)>,
    rates: Option<(LineConfig, LineConfig)>,
    /// Values read from the characters that are left out.
    marks: Vec<Mark>,
}

impl Resampler {
    /// Replaces `bytes`, sent back to back from `start` on, by the bytes that the receiver has read
    /// by their end. A character that is still being sampled comes with the next call, or with
    /// [`idle`](Self::idle). Returns the number of characters without a valid stop bit or with a
    /// wrong parity bit, which are left out.
    pub(crate) fn feed(
        &mut self,
        bytes: &mut Vec<u8>,
        start: Instant,
        sender: LineConfig,
        receiver: LineConfig,
    ) -> u32 {
        let mut received = Vec::new();
        let mut errors = 0;
        if self.rates != Some((sender, receiver)) {
            errors += self.idle(&mut received);
            self.rates = Some((sender, receiver));
        }
        if let Some((end, _)) = self.end {
            let bit_ns = 1_000_000_000 / u64::from(sender.baud);
            let gap = u64::try_from((start - end).as_nanos()).unwrap_or(u64::MAX) / bit_ns.max(1);
            let idle_bits = usize::try_from(gap.min(IDLE_BITS_MAX)).expect("small");
            self.bits.extend(core::iter::repeat_n(true, idle_bits));
        }
        bytes
            .iter()
            .for_each(|&byte| push_character(&mut self.bits, byte, sender));
        let duration = sender.bytes_time(bytes.len() as u64);
        self.end = Some((
            start + duration,
            receiver.bytes_time(2).max(sender.bytes_time(2)),
        ));
        errors += self.sample(&mut received);
        *bytes = received;
        errors
    }

    /// Takes the values read from characters without a valid stop bit, with their positions among
    /// the bytes of the last call.
    pub(crate) fn take_marks(&mut self) -> Vec<Mark> {
        core::mem::take(&mut self.marks)
    }

    /// Time at which [`idle`](Self::idle) must be called if no bytes arrive before.
    pub(crate) fn idle_at(&self) -> Option<Instant> {
        self.end.map(|(end, quiet)| end + quiet)
    }

    /// Ends the current character in idle level, because the line is quiet.
    pub(crate) fn idle(&mut self, received: &mut Vec<u8>) -> u32 {
        self.end = None;
        let Some((sender, receiver)) = self.rates else {
            return 0;
        };
        let character = u64::from(receiver.bits_per_byte()) * u64::from(sender.baud);
        let bits = character / u64::from(receiver.baud) + IDLE_BITS;
        let bits = usize::try_from(bits.min(IDLE_BITS_MAX)).expect("small");
        self.bits.extend(core::iter::repeat_n(true, bits));
        let errors = self.sample(received);
        self.bits.clear();
        self.phase = 0;
        errors
    }

    fn sample(&mut self, received: &mut Vec<u8>) -> u32 {
        let Some((sender, receiver)) = self.rates else {
            return 0;
        };
        let sender_bit = 2 * u64::from(receiver.baud);
        let receiver_bit = 2 * u64::from(sender.baud);
        // A receiver looks at one stop bit only.
        let more_stops = u64::from(receiver.stop_bits.saturating_sub(1));
        let frame_bits = u64::from(receiver.bits_per_byte()) - more_stops;
        let mut errors = 0;
        let mut at = self.phase;
        let level = |bits: &[bool], at: u64| {
            usize::try_from(at / sender_bit)
                .ok()
                .and_then(|index| bits.get(index))
                .copied()
        };
        loop {
            let Some(edge) = falling_edge(&self.bits, at, sender_bit) else {
                // No character begins in the remaining bits; keep the last level for the next edge.
                at = (self.bits.len() as u64)
                    .saturating_sub(1)
                    .max(at / sender_bit)
                    * sender_bit;
                break;
            };
            let sample =
                |index: u64| level(&self.bits, edge + index * receiver_bit + receiver_bit / 2);
            if level(&self.bits, edge + frame_bits * receiver_bit).is_none() {
                at = edge;
                break;
            }
            let next = edge + (frame_bits - 1) * receiver_bit + receiver_bit / 2;
            if sample(0) == Some(true) {
                at = edge + receiver_bit / 2;
                continue;
            }
            let byte = (0..receiver.data_bits).fold(0_u8, |byte, bit| {
                byte | u8::from(sample(1 + u64::from(bit)) == Some(true)) << bit
            });
            let is_stopped = sample(frame_bits - 1) == Some(true);
            let is_odd = (byte.count_ones() % 2 == 1)
                != (sample(1 + u64::from(receiver.data_bits)) == Some(true));
            let is_right = match receiver.parity {
                Parity::None => true,
                Parity::Even => !is_odd,
                Parity::Odd => is_odd,
            };
            if is_stopped && is_right {
                received.push(byte);
            } else {
                errors += 1;
                let is_low = (1..frame_bits).all(|bit| sample(bit) == Some(false));
                self.marks.push(Mark {
                    before: received.len(),
                    value: byte,
                    damage: match is_low {
                        true => MarkDamage::Break,
                        false if is_stopped => MarkDamage::Parity,
                        false => MarkDamage::Framing,
                    },
                });
            }
            at = next;
        }
        let passed = usize::try_from(at / sender_bit)
            .unwrap_or(usize::MAX)
            .min(self.bits.len());
        self.bits.drain(..passed);
        self.phase = at - passed as u64 * sender_bit;
        errors
    }
}

/// Idle bits that separate two bursts for certain.
const IDLE_BITS: u64 = 24;
/// Limit for extreme ratios of the rates.
const IDLE_BITS_MAX: u64 = 100_000;

/// The first change from high to low at or after `at`. The level before the first bit counts as
/// high. A line that was already low before `at` has no edge there: a receiver waits for a change.
fn falling_edge(bits: &[bool], at: u64, bit: u64) -> Option<u64> {
    let mut index = usize::try_from(at / bit).ok()?;
    if at.is_multiple_of(bit) && bits.get(index) == Some(&false) && (index == 0 || bits[index - 1])
    {
        return Some(at);
    }
    loop {
        let (before, after) = (bits.get(index)?, bits.get(index + 1)?);
        index += 1;
        if *before && !*after {
            return Some(index as u64 * bit);
        }
    }
}

fn push_character(bits: &mut Vec<bool>, byte: u8, line: LineConfig) {
    bits.push(false);
    bits.extend((0..line.data_bits).map(|bit| byte >> bit & 1 == 1));
    let ones = (byte & (0xFF >> (8 - line.data_bits.clamp(1, 8)))).count_ones();
    match line.parity {
        Parity::None => {}
        Parity::Even => bits.push(ones % 2 == 1),
        Parity::Odd => bits.push(ones.is_multiple_of(2)),
    }
    bits.extend(core::iter::repeat_n(true, usize::from(line.stop_bits)));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(sent: &[u8], sender: u32, receiver: u32) -> (Vec<u8>, u32) {
        let mut resampler = Resampler::default();
        let mut bytes = sent.to_vec();
        let [sender, receiver] = [sender, receiver].map(LineConfig::new_8n1);
        let mut errors = resampler.feed(&mut bytes, Instant::ZERO, sender, receiver);
        errors += resampler.idle(&mut bytes);
        (bytes, errors)
    }

    #[test]
    fn equal_rates_give_the_bytes_back() {
        let all: Vec<u8> = (0..=255).collect();
        assert_eq!(read(&all, 115_200, 115_200), (all, 0));
    }

    /// By hand: 0x55 is low and high in turn, beginning low. At half the rate the middle of the
    /// start bit falls on the rising edge behind it: a false start, at each of the five falling
    /// edges. No byte is read.
    #[test]
    fn half_the_rate_sees_only_false_starts_in_0x55() {
        assert_eq!(read(&[0x55], 115_200, 57_600), (vec![], 0));
    }

    /// By hand: 0x00 at 115200 is nine bits low, then high. At 57600 the samples lie at sender's
    /// bits 1 (start), 3, 5, 7 (low), 9, 11, 13, 15, 17 (high: stop bit and idle), stop 19: data
    /// 000 11111 from the least significant bit, 0xF8.
    #[test]
    fn a_zero_byte_read_at_half_the_rate_is_f8() {
        assert_eq!(read(&[0x00], 115_200, 57_600), (vec![0xF8], 0));
    }

    /// The AVR's debug port runs at 111111 baud and is read at 115200: 3.5 % is still inside the
    /// half bit that ten bits may drift (10 x 3.6 % = 36 % of a bit).
    #[test]
    fn three_and_a_half_per_cent_is_tolerated() {
        let text = b"reset by watchdog".to_vec();
        assert_eq!(read(&text, 111_111, 115_200), (text, 0));
    }

    /// By hand: a bit of the receiver is 115200 / 111111 = 1.0368 bits of the sender. It looks at
    /// 1.555, 2.592, 3.629, 4.666, 5.702, 6.739, 7.776, 8.813 and, for the stop bit, 9.850: in each
    /// bit of the sender once, in order, and before the next character begins at 10.
    #[test]
    fn a_line_of_115200_read_at_111111_is_read_right() {
        let all: Vec<u8> = (0..=255).collect();
        assert_eq!(read(&all, 115_200, 111_111), (all, 0));
    }

    /// Two UARTs that tolerate each other read all bytes right, at any rates; a little beyond, they
    /// do not.
    #[test]
    fn rates_that_are_tolerated_change_no_byte() {
        let all: Vec<u8> = (0..=255).chain((0..=255).rev()).collect();
        let right = |sender, receiver| read(&all, sender, receiver) == (all.clone(), 0);
        for baud in [1_200, 9_615, 57_600, 117_647, 250_000] {
            let line = LineConfig::new_8n1(baud);
            for ppm in (-70_000_i64..=70_000).step_by(500) {
                let other = u32::try_from(i64::from(baud) * (1_000_000 + ppm) / 1_000_000);
                let other = other.expect("a rate");
                let is_right = right(baud, other) && right(other, baud);
                let is_clear = ppm.abs() < 50_000 || ppm.abs() > 56_000;
                assert!(
                    line.tolerates(other) == is_right || !is_clear,
                    "{baud} {other}"
                );
            }
        }
    }

    /// By hand, bits of the sender numbered from the first start bit, L low and H high:
    ///
    /// ```text
    /// number     0  1 2 3 4 5 6 7 8  9  10 11 ...                    19
    /// 48 69      L  L L L H L L H L  H  L  H L L H L H H L           H
    /// 61 62      L  H L L L L H H L  H  L  L H L L L H H L           H
    /// 00 00      L  L L L L L L L L  H  L  L L L L L L L L           H
    /// ```
    ///
    /// From an edge at `e` the receiver, whose bits are twice as long, looks for its start bit at
    /// `e + 1`, for data at `e + 3`, `e + 5` .. `e + 17`, for its stop bit at `e + 19`.
    ///
    /// - 48 69, `e` = 0: start L; data L L H H H L L H, stop H: 1001 1100.
    /// - 61 62: bit 1 is H, a false start; `e` = 2: start L; data (5, 7 .. 19) L H H L L L H H,
    ///   stop (21, idle) H: 1100 0110.
    /// - 00 00, `e` = 0: data L L L H L L L L, stop H: 0000 1000.
    /// - 03 00 01: bit 1 is H, a false start; `e` = 3: start L; data (6, 8 .. 20) L, stop (22) L,
    ///   so it is none. But with bit 22, L behind the H of 21, the next one begins: start (23) L;
    ///   data (25, 27) L L, (29, 31 .. idle) H H H H H H, stop H: 1111 1100.
    /// - 61 62 00: as the second, but bit 21 is in the low third character: no stop bit. The next
    ///   edge would be behind it; there is none.
    #[test]
    fn a_line_of_115200_read_at_57600_gives_what_lies_at_every_other_bit() {
        let half = |sent: &[u8]| read(sent, 115_200, 57_600);
        assert_eq!(half(&[0x48, 0x69]), (vec![0b1001_1100], 0));
        assert_eq!(half(&[0x61, 0x62]), (vec![0b1100_0110], 0));
        assert_eq!(half(&[0x00, 0x00]), (vec![0b0000_1000], 0));
        assert_eq!(half(&[0x03, 0x00, 0x01]), (vec![0b1111_1100], 1));
        assert_eq!(half(&[0x61, 0x62, 0x00]), (vec![], 1));
    }

    /// By hand, as above: 61 62 00 is C6 with a low stop bit. 03 00 01 is low in all data bits and
    /// in the stop bit from the edge at 3 on: a break; a sound character follows it.
    #[test]
    fn what_has_no_stop_bit_was_read_all_the_same() {
        let marks = |sent: &[u8]| {
            let mut resampler = Resampler::default();
            let [sender, receiver] = [115_200, 57_600].map(LineConfig::new_8n1);
            let mut bytes = sent.to_vec();
            resampler.feed(&mut bytes, Instant::ZERO, sender, receiver);
            resampler.idle(&mut bytes);
            resampler.take_marks()
        };
        let mark = |value, damage| Mark {
            before: 0,
            value,
            damage,
        };
        assert_eq!(marks(&[0x48, 0x69]), []);
        assert_eq!(
            marks(&[0x61, 0x62, 0x00]),
            [mark(0xC6, MarkDamage::Framing)]
        );
        assert_eq!(marks(&[0x03, 0x00, 0x01]), [mark(0, MarkDamage::Break)]);
    }

    /// By hand, in bits of the sender, of which the receiver has ten per bit of its own. The first
    /// zero is low from 0 to 9. The second one is low again after the given number of bits from the
    /// end of the first character at 10. From an edge at 0 the receiver samples the start bit at 5,
    /// data at 15, 25 .. 85, and the stop bit at 95.
    ///
    /// - 48: low from 58 to 67, so data bit 5 (65) is low: 1101 1111.
    /// - 80: low from 90 to 99, so all data bits are high, there is no stop bit at 95, and no
    ///   character begins after that.
    /// - 120: low from 130 to 139; all data bits of the first character are high, and so are those
    ///   of the second.
    #[test]
    fn a_pause_is_as_long_for_a_slow_receiver_as_for_the_sender() {
        let [sender, receiver] = [100_000, 10_000].map(LineConfig::new_8n1);
        let after = |pause: u64| {
            let mut resampler = Resampler::default();
            let [mut first, mut second, mut rest] = [vec![0], vec![0], vec![]];
            let start = Instant::from_micros(100 + 10 * pause);
            let errors = resampler.feed(&mut first, Instant::ZERO, sender, receiver)
                + resampler.feed(&mut second, start, sender, receiver)
                + resampler.idle(&mut rest);
            ([first, second, rest].concat(), errors)
        };
        assert_eq!(after(48), (vec![0b1101_1111], 0));
        assert_eq!(after(80), (vec![], 1));
        assert_eq!(after(120), (vec![0xFF, 0xFF], 0));
    }

    #[test]
    fn twelve_per_cent_is_not() {
        let text = b"reset by watchdog".to_vec();
        assert_ne!(read(&text, 128_000, 115_200).0, text);
    }

    #[test]
    fn chunks_make_no_difference() {
        let bytes: Vec<u8> = (0..200_u8).map(|i| i.wrapping_mul(37)).collect();
        let whole = read(&bytes, 115_200, 100_000);

        let mut resampler = Resampler::default();
        let [sender, receiver] = [115_200, 100_000].map(LineConfig::new_8n1);
        let (mut all, mut errors, mut sent) = (Vec::new(), 0, 0);
        for chunk in bytes.chunks(7) {
            let mut piece = chunk.to_vec();
            let start = Instant::ZERO + sender.bytes_time(sent);
            errors += resampler.feed(&mut piece, start, sender, receiver);
            all.append(&mut piece);
            sent += chunk.len() as u64;
        }
        errors += resampler.idle(&mut all);
        assert_eq!((all, errors), whole);
    }

    /// `sent` at its own rate, back to back, then silence.
    fn through(sent: &[u8], sender: LineConfig, receiver: LineConfig) -> (Vec<u8>, u32) {
        let mut resampler = Resampler::default();
        let mut bytes = sent.to_vec();
        let mut errors = resampler.feed(&mut bytes, Instant::ZERO, sender, receiver);
        errors += resampler.idle(&mut bytes);
        (bytes, errors)
    }

    fn coding(data_bits: u8, parity: Parity, stop_bits: u8) -> LineConfig {
        LineConfig {
            data_bits,
            parity,
            stop_bits,
            ..LineConfig::new_8n1(9600)
        }
    }

    /// By hand, at one rate. Seven data bits and even parity are eight data bits for a receiver
    /// without parity: 0x41 and 0x42 have two ones each and parity 0; 0x43 has three and parity 1.
    /// With odd parity it is the opposite. The receiver with parity takes the eighth bit as parity,
    /// and its byte does not contain the bit.
    #[test]
    fn a_parity_bit_is_the_eighth_to_who_knows_none() {
        let plain = LineConfig::new_8n1(9600);
        let (even, odd) = (coding(7, Parity::Even, 1), coding(7, Parity::Odd, 1));
        let sent = [0x41, 0x42, 0x43];
        assert_eq!(through(&sent, even, plain), (vec![0x41, 0x42, 0xC3], 0));
        assert_eq!(through(&sent, odd, plain), (vec![0xC1, 0xC2, 0x43], 0));
        assert_eq!(through(&[0x41, 0xC3], plain, even), (vec![0x41, 0x43], 0));
        assert_eq!(through(&[0xC1, 0x43], plain, even), (vec![], 2));
    }

    /// Bits beyond a line's five do not count for its parity either: 0xE1 is sent as 00001, one
    /// one.
    #[test]
    fn a_short_character_carries_its_low_bits() {
        let short = coding(5, Parity::Even, 2);
        let seven = coding(7, Parity::None, 1);
        // Five data bits 10000 from the lowest, parity 1, two stop bits: the receiver gets 10000 1
        // 1.
        assert_eq!(through(&[0xE1], short, seven), (vec![0b110_0001], 0));
        assert_eq!(through(&[0xE1, 0xFF], short, short), (vec![0x01, 0x1F], 0));
    }

    /// A second stop bit is a bit of idle line, and a receiver looks at the first one only (16550,
    /// ATmega328P: USBSn).
    #[test]
    fn a_second_stop_bit_is_not_looked_at() {
        let (one, two) = (coding(8, Parity::None, 1), coding(8, Parity::None, 2));
        assert_eq!(through(&[0x55, 0xAA], two, one), (vec![0x55, 0xAA], 0));
        assert_eq!(through(&[0xFF, 0x55], one, two), (vec![0xFF, 0x55], 0));
    }

    /// A receiver of 8E1 reads the stop bit of 8N1 as a parity bit, and the next start bit as its
    /// stop bit. 0x01 has an odd number of ones, so the stop bit of the last character is a correct
    /// parity bit.
    #[test]
    fn a_missing_parity_bit_is_an_error_of_most_characters() {
        let (none, even) = (coding(8, Parity::None, 1), coding(8, Parity::Even, 1));
        assert_eq!(through(&[0x01], none, even), (vec![0x01], 0));
        assert_eq!(through(&[0x03], none, even), (vec![], 1));
        assert_eq!(
            through(&[0x03], even, coding(8, Parity::Odd, 1)),
            (vec![], 1)
        );
    }

    /// Bits of 100 us. A byte 2.4 ms later, 24 bits, is read separately. A receiver that is still
    /// within a character when more bytes follow directly continues with their bits.
    #[test]
    fn a_gap_is_idle_line_and_none_is_none() {
        let [sender, receiver] = [10_000, 5_000].map(LineConfig::new_8n1);
        let at = Instant::from_micros;
        let read = |starts: [u64; 2]| {
            let mut resampler = Resampler::default();
            let mut all = Vec::new();
            for (start, byte) in starts.into_iter().zip([0x48, 0x69]) {
                let mut bytes = vec![byte];
                resampler.feed(&mut bytes, at(start), sender, receiver);
                all.append(&mut bytes);
            }
            assert_eq!(resampler.idle_at(), Some(at(starts[1] + 1000 + 4000)));
            resampler.idle(&mut all);
            assert_eq!(resampler.idle_at(), None);
            all
        };
        // By hand, see above: together 9C. Alone 48 is L LLLHLLHL H: data (3, 5, .. 17) L H H H..:
        // bit 3 is L, 5 L, 7 H, 9 and later H, and 69 is L HLLHLHHL H: a false start, then from 2
        // on start 3 L, data 5 L, 7 H, 9 H and later H.
        assert_eq!(read([0, 1000]), [0x9C]);
        assert_eq!(read([0, 3400]), [0b1111_1100, 0b1111_1110]);
    }

    /// A slow receiver takes the whole fast character 41 (87 us) for a start bit (104 us), because
    /// the middle of that bit, at 52 us, lies in the low bit 5. A change of rates ends this
    /// character at once.
    #[test]
    fn a_change_of_rates_ends_what_was_being_read() {
        let [slow, fast] = [9_600, 115_200].map(LineConfig::new_8n1);
        let mut resampler = Resampler::default();
        let mut first = vec![0x41];
        resampler.feed(&mut first, Instant::ZERO, fast, slow);
        assert!(first.is_empty());
        let mut second = vec![0x41, 0x42];
        let start = Instant::from_millis(50);
        let errors = resampler.feed(&mut second, start, slow, slow);
        assert_eq!((&*second, errors), (&[0xFF, 0x41][..], 0));
        resampler.idle(&mut second);
        assert_eq!(second, [0xFF, 0x41, 0x42]);
    }
    /// The receiver with parity still waits for the bit behind 03, whose stop bit is its wrong
    /// parity bit. A change of rates ends the character, with its error.
    #[test]
    fn an_error_that_a_change_of_rates_brings_is_counted() {
        let (none, even) = (coding(8, Parity::None, 1), coding(8, Parity::Even, 1));
        let mut resampler = Resampler::default();
        let mut bytes = vec![0x03];
        assert_eq!(resampler.feed(&mut bytes, Instant::ZERO, none, even), 0);
        let mut next = vec![0x41];
        let errors = resampler.feed(&mut next, Instant::from_millis(50), none, none);
        assert_eq!((bytes, errors), (vec![], 1));
    }

    /// All data bits and the parity bit of a zero are low. With odd parity that bit is wrong, but
    /// the stop bit is high: this is no break.
    #[test]
    fn a_zero_with_a_wrong_parity_bit_is_no_break() {
        let (even, odd) = (coding(8, Parity::Even, 1), coding(8, Parity::Odd, 1));
        let mut resampler = Resampler::default();
        let mut bytes = vec![0];
        resampler.feed(&mut bytes, Instant::ZERO, even, odd);
        resampler.idle(&mut bytes);
        let damages: Vec<_> = resampler
            .take_marks()
            .iter()
            .map(|mark| mark.damage)
            .collect();
        assert_eq!(damages, [MarkDamage::Parity]);
    }

    /// Each coding reads its own characters, whatever their bits: 256 bytes, of which the line
    /// carries the low ones.
    #[test]
    fn each_coding_reads_its_own_characters() {
        for (data_bits, mask) in [(5, 0x1F_u8), (6, 0x3F), (7, 0x7F), (8, 0xFF)] {
            for parity in [Parity::None, Parity::Even, Parity::Odd] {
                for stop_bits in [1, 2] {
                    let line = coding(data_bits, parity, stop_bits);
                    let all: Vec<u8> = (0..=255).collect();
                    let low: Vec<u8> = all.iter().map(|byte| byte & mask).collect();
                    assert_eq!(through(&all, line, line), (low, 0), "{line:?}");
                }
            }
        }
    }

    /// With even parity 0x80, one one, has a parity bit of 1, and 0xC1, three ones, as well. Only
    /// with seven data bits the highest one is no part of it: 0xC1 is 0x41 with two ones.
    #[test]
    fn the_highest_data_bit_counts_for_its_parity() {
        let parity_bit = |byte: u8, data_bits| {
            let mut bits = Vec::new();
            push_character(&mut bits, byte, coding(data_bits, Parity::Even, 1));
            bits[usize::from(data_bits) + 1]
        };
        let parity = [0x80, 0xC1, 0x81].map(|byte| parity_bit(byte, 8));
        assert_eq!(parity, [true, true, false]);
        let parity = [0x80, 0xC1, 0x81].map(|byte| parity_bit(byte, 7));
        assert_eq!(parity, [false, false, true]);
    }

    /// By hand, a receiver at two thirds of the rate: from the edge at 0 it looks for data at 2.25,
    /// 3.75, 5.25, 6.75, 8.25, 9.75, 11.25 and 12.75 and for its stop bit at 14.25. Behind the low
    /// bits 1 to 8 of 00 only the stop bit 9 is high, so the value is 0010 0000. Of 04 only bit 13
    /// is high: bit 14 is low, and began before the receiver looked. It has no edge to begin with.
    #[test]
    fn a_low_bit_that_began_before_is_no_edge() {
        let [sender, receiver] = [90_000, 60_000].map(LineConfig::new_8n1);
        let mut resampler = Resampler::default();
        let mut bytes = vec![0x00, 0x04];
        let mut errors = resampler.feed(&mut bytes, Instant::ZERO, sender, receiver);
        errors += resampler.idle(&mut bytes);
        assert_eq!((bytes, errors), (vec![], 1));
        let framing = Mark {
            before: 0,
            value: 0b0010_0000,
            damage: MarkDamage::Framing,
        };
        assert_eq!(resampler.take_marks(), [framing]);
    }

    /// By hand, a receiver at an eighth of the rate looks at 4 for its start bit, at 12, 20 .. 68
    /// for data, and at 76 for its stop bit: all are low, a break. Of 02, from bit 70 on, only bit
    /// 72 is high. The fall at 73 lies before 76 and begins no character, although bits 73 to 78
    /// are low.
    #[test]
    fn an_edge_before_the_middle_of_the_stop_bit_begins_nothing() {
        let [sender, receiver] = [80_000, 10_000].map(LineConfig::new_8n1);
        let mut resampler = Resampler::default();
        let mut bytes = vec![0, 0, 0, 0, 0, 0, 0, 2];
        let mut errors = resampler.feed(&mut bytes, Instant::ZERO, sender, receiver);
        errors += resampler.idle(&mut bytes);
        assert_eq!((bytes, errors), (vec![], 1));
        let low = Mark {
            before: 0,
            value: 0,
            damage: MarkDamage::Break,
        };
        assert_eq!(resampler.take_marks(), [low]);
    }

    /// Marks are taken once.
    #[test]
    fn marks_are_taken_once() {
        let (none, even) = (coding(8, Parity::None, 1), coding(8, Parity::Even, 1));
        let mut resampler = Resampler::default();
        let mut bytes = vec![0x03];
        resampler.feed(&mut bytes, Instant::ZERO, none, even);
        resampler.idle(&mut bytes);
        let marks = resampler.take_marks();
        assert_eq!((marks.len(), resampler.take_marks().len()), (1, 0));
    }

    /// A hundred characters back to back, each fed by itself, at another rate than that of the
    /// receiver: only bits of the last one or two, ten each, may be left to read.
    #[test]
    fn bits_that_were_read_are_not_kept() {
        let [sender, receiver] = [115_200, 100_000].map(LineConfig::new_8n1);
        let mut resampler = Resampler::default();
        for number in 0..100 {
            let start = Instant::ZERO + sender.bytes_time(number);
            resampler.feed(&mut vec![0x55], start, sender, receiver);
            assert!(resampler.bits.len() <= 20, "{number}");
        }
    }
}
