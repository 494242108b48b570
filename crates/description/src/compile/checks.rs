//! `checksum`: the covered bytes and the position of the checksum.

use super::Compiler;
use crate::checksum::{Algorithm, Polynomial};
use crate::framing::{Check, Cut};
use crate::schema::short::Short;
use crate::schema::wire::{ChecksumSpec, Encoding, Endian, FrameSpec};

impl Compiler<'_> {
    /// The checksums, the holes of sync bytes and checksums in the content, and the length of the
    /// trailer.
    pub(super) fn checks(
        &mut self,
        key: &str,
        spec: &FrameSpec,
        cut: &Cut,
        sync: &[u8],
        end: usize,
    ) -> (Vec<Check>, Vec<(usize, usize)>, usize) {
        let mut checks = Vec::new();
        let is_single = spec.checksum.0.len() == 1;
        for (index, Short(check)) in spec.checksum.0.iter().enumerate() {
            let key = match is_single {
                true => format!("{key}.checksum"),
                false => format!("{key}.checksum[{index}]"),
            };
            let from = check.from;
            if let Some(mut check) = self.check_spec(&key, check) {
                // LIN covers no sync byte.
                let first = match cut {
                    Cut::Marked { .. } => 0,
                    _ => sync.len(),
                };
                if let (Some(left_out), None) = (check.algorithm.left_out(), from) {
                    check.from = left_out + i64::try_from(first).unwrap_or(0);
                }
                checks.push((key, check));
            }
        }
        let mut holes = Vec::new();
        if !matches!(cut, Cut::Marked { .. }) && !sync.is_empty() {
            holes.push((0, sync.len()));
        }
        // Checksums at the end without `at` follow each other.
        let mut behind = end;
        for (index, (_, check)) in checks.iter_mut().enumerate().rev() {
            let given = spec.checksum.0.get(index).and_then(|Short(spec)| spec.at);
            if given.is_none() {
                behind += check.len();
                check.at = -i64::try_from(behind).unwrap_or(0);
            }
        }
        let mut trailer = behind;
        for (key, check) in &checks {
            if let Ok(at) = usize::try_from(check.at) {
                let hole = (at, check.len());
                let overlaps = holes
                    .iter()
                    .any(|(other, len)| *other < at + hole.1 && at < other + len);
                if overlaps {
                    let message =
                        "overlaps the sync bytes or another checksum, expected its own bytes";
                    self.wrong(format!("{key}.at"), message);
                }
                holes.push(hole);
            } else {
                let from_end = usize::try_from(-check.at).unwrap_or(0);
                if from_end < check.len() {
                    let message = format!("is {}, expected -{} at most", check.at, check.len());
                    self.wrong(format!("{key}.at"), message);
                }
                trailer = trailer.max(from_end);
            }
        }
        holes.sort_unstable();
        (
            checks.into_iter().map(|(_, check)| check).collect(),
            holes,
            trailer,
        )
    }

    fn check_spec(&mut self, key: &str, spec: &ChecksumSpec) -> Option<Check> {
        let found = match (&spec.algorithm, &spec.polynomial) {
            (Some(name), None) => Algorithm::named(name),
            (None, Some(own)) => Algorithm::of(Polynomial {
                width: own.width,
                poly: own.poly,
                init: own.init,
                refin: own.refin,
                refout: own.refout,
                xorout: own.xorout,
            }),
            _ => Err("expected either \"algorithm\" or \"polynomial\"".to_owned()),
        };
        let (algorithm, bytes) = match found {
            Ok(found) => found,
            Err(message) => {
                self.wrong(key, message);
                return None;
            }
        };
        let is_nmea = spec
            .algorithm
            .as_ref()
            .is_some_and(|name| name.eq_ignore_ascii_case("nmea"));
        let width = spec.bytes.unwrap_or(bytes);
        if !(1..=16).contains(&width) {
            self.wrong(
                format!("{key}.bytes"),
                format!("is {width}, expected 1 to {bytes}"),
            );
        }
        let algorithm = self.sent_part(key, spec, algorithm, width.clamp(1, 16));
        // Modbus sends its CRC low byte first; this fixed order is part of the algorithm's name.
        let named = |name: &str| {
            spec.algorithm
                .as_ref()
                .is_some_and(|own| own.eq_ignore_ascii_case(name))
        };
        let fixed = (named("modbus") || named("ubx")).then_some(Endian::Little);
        let endian = spec.endian.or(fixed).or(self.schema.endian);
        if endian.is_none() && width > 1 {
            let message = "has no order of bytes, expected endian = \"little\" or \"big\"";
            self.wrong(key, message);
        }
        let separator = match (&spec.separator, is_nmea) {
            (Some(separator), _) => separator.0.clone(),
            (None, true) => b"*".to_vec(),
            (None, false) => Vec::new(),
        };
        Some(Check {
            algorithm,
            width: width.clamp(1, 16),
            is_little: endian == Some(Endian::Little),
            is_hex: spec
                .encoding
                .map_or(is_nmea, |encoding| encoding == Encoding::Hex),
            separator,
            extra: spec.extra.clone().unwrap_or_default().0,
            before: spec.before.clone().unwrap_or_default().0,
            from: spec.from.unwrap_or(0).into(),
            to: spec.to.map(i64::from),
            at: spec.at.unwrap_or(-1).into(),
        })
    }
    /// The algorithm with the bits of its result that are sent.
    fn sent_part(
        &mut self,
        key: &str,
        spec: &ChecksumSpec,
        algorithm: Algorithm,
        width: u8,
    ) -> Algorithm {
        let most = algorithm.bits(width);
        let algorithm = match spec.bits {
            None => algorithm,
            Some(bits) if (1..=most).contains(&bits) => algorithm.of_low_bits(bits),
            Some(bits) => {
                let message = format!(
                    "is {bits}, expected 1 to {most}: the bits of \"{}\" in {width} bytes",
                    algorithm.name()
                );
                self.wrong(format!("{key}.bits"), message);
                algorithm
            }
        };
        let plus = u128::from(spec.plus.unwrap_or(0));
        let limit = u128::MAX >> (128 - 8 * u32::from(width));
        if plus > limit {
            let message =
                format!("is {plus}, expected 0 to {limit}: the checksum is sent in {width} bytes");
            self.wrong(format!("{key}.plus"), message);
        }
        match spec.plus {
            None => algorithm,
            Some(plus) => algorithm.plus(plus.into()),
        }
    }
}
