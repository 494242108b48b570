//! Decompression of gzip, zstd and lz4 up to a limit. Damaged data give the bytes before the
//! damage.

use std::io::Read;

use lz4_flex::frame::FrameDecoder;
use ruzstd::decoding::StreamingDecoder;

/// Maximum decompressed size of a file or a part of it, bytes.
pub const BYTES_MAX: u64 = 1 << 30;

/// Decompressed size that is always allowed, bytes.
const SMALL: u64 = 64 << 20;
/// Above `SMALL`, maximum ratio of decompressed to compressed size. Sensor logs, even as text,
/// compress to a tenth or so.
const RATIO_MAX: u64 = 100;

/// First bytes of compressed data.
pub const GZIP: &[u8] = &[0x1F, 0x8B];
/// First bytes of compressed data.
pub const ZSTD: &[u8] = &[0x28, 0xB5, 0x2F, 0xFD];
/// First bytes of compressed data.
pub const LZ4: &[u8] = &[0x04, 0x22, 0x4D, 0x18];

/// The decompressed bytes, and the reason why the rest is missing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Unpacked {
    /// All bytes before the damage; empty above the limit.
    pub bytes: Vec<u8>,
    /// The error.
    pub error: Option<String>,
}

impl Unpacked {
    /// The bytes, if there was no error.
    ///
    /// # Errors
    /// The error of the decompression.
    pub fn whole(self) -> Result<Vec<u8>, String> {
        self.error.map_or(Ok(self.bytes), Err)
    }
}

/// Decompresses data with a known signature, to at most `most` bytes and within the plausible
/// ratio; `None` for other data.
pub fn any(bytes: &[u8], most: u64) -> Option<Unpacked> {
    let likely = (bytes.len() as u64).saturating_mul(RATIO_MAX);
    let most = most.min(likely.max(SMALL));
    let unpack = [
        (GZIP, gzip as fn(&[u8], u64) -> _),
        (ZSTD, zstd),
        (LZ4, lz4),
    ];
    let (_, unpack) = unpack.iter().find(|(magic, _)| bytes.starts_with(magic))?;
    Some(unpack(bytes, most))
}

/// Decompresses gzip to at most `most` bytes.
pub fn gzip(bytes: &[u8], most: u64) -> Unpacked {
    let mut out = Unpacked::default();
    out.read(flate2::read::MultiGzDecoder::new(bytes), most);
    out
}

/// Decompresses consecutive zstd frames to at most `most` bytes.
pub fn zstd(bytes: &[u8], most: u64) -> Unpacked {
    frames(bytes, most, |rest, out| match StreamingDecoder::new(rest) {
        Ok(decoder) => out.read(decoder, most),
        Err(error) => out.error = Some(format!("no zstd: {error}")),
    })
}

/// Decompresses consecutive lz4 frames to at most `most` bytes.
pub fn lz4(bytes: &[u8], most: u64) -> Unpacked {
    frames(bytes, most, |rest, out| {
        // An empty frame consumes its own length and returns no bytes.
        out.read(FrameDecoder::new(rest), most);
    })
}

/// Decompresses consecutive frames, up to the first error.
fn frames(
    mut rest: &[u8],
    most: u64,
    mut unpack: impl FnMut(&mut &[u8], &mut Unpacked),
) -> Unpacked {
    let mut out = Unpacked::default();
    while !rest.is_empty() && out.error.is_none() {
        if let Some(behind) = behind_skippable(rest) {
            rest = behind;
            continue;
        }
        let before = rest.len();
        unpack(&mut rest, &mut out);
        if rest.len() == before {
            out.error.get_or_insert_with(|| "no frame".to_owned());
        }
    }
    debug_assert!(out.bytes.len() as u64 <= most);
    out
}

/// The bytes behind a skippable frame.
fn behind_skippable(bytes: &[u8]) -> Option<&[u8]> {
    let (magic, rest) = bytes.split_first_chunk::<4>()?;
    let (len, rest) = rest.split_first_chunk::<4>()?;
    let is_skippable = u32::from_le_bytes(*magic) & 0xFFFF_FFF0 == 0x184D_2A50;
    let len = u32::from_le_bytes(*len) as usize;
    is_skippable.then(|| rest.get(len..).unwrap_or_default())
}

impl Unpacked {
    /// Adds the output of `decoder`.
    fn read(&mut self, decoder: impl Read, most: u64) {
        let room = most.saturating_add(1) - self.bytes.len() as u64;
        if let Err(error) = decoder.take(room).read_to_end(&mut self.bytes) {
            self.error = Some(error.to_string());
        }
        if self.bytes.len() as u64 > most {
            self.bytes = Vec::new();
            self.error = Some(format!("unpacks to more than {most} bytes"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    /// 120 times the letters a to j and a line end, compressed by the original zstd library at
    /// level 19, with checksum.
    const ZSTD_OF_OTHERS: &[u8] = &[
        0x28, 0xB5, 0x2F, 0xFD, 0x64, 0x28, 0x04, 0x95, 0x00, 0x00, 0x58, 0x61, 0x62, 0x63, 0x64,
        0x65, 0x66, 0x67, 0x68, 0x69, 0x6A, 0x0A, 0x01, 0x00, 0x1A, 0xF9, 0x2F, 0x5E, 0x28, 0xEE,
        0xE7, 0x8C,
    ];
    /// The same, compressed by the original lz4 library, with a checksum of the content.
    const LZ4_OF_OTHERS: &[u8] = &[
        0x04, 0x22, 0x4D, 0x18, 0x6C, 0x40, 0x28, 0x05, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x63,
        0x1A, 0x00, 0x00, 0x00, 0xBF, 0x61, 0x62, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6A,
        0x0A, 0x0B, 0x00, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x0A, 0x50, 0x67, 0x68, 0x69, 0x6A, 0x0A,
        0x00, 0x00, 0x00, 0x00, 0x91, 0xA6, 0xEB, 0x25,
    ];

    fn text() -> Vec<u8> {
        b"abcdefghij\n".repeat(120)
    }

    fn zstd_of(bytes: &[u8]) -> Vec<u8> {
        let level = ruzstd::encoding::CompressionLevel::Fastest;
        ruzstd::encoding::compress_to_vec(bytes, level)
    }

    fn lz4_of(bytes: &[u8]) -> Vec<u8> {
        use lz4_flex::frame::{BlockSize, FrameEncoder, FrameInfo};
        let blocks = FrameInfo::new().block_size(BlockSize::Max64KB);
        let mut encoder = FrameEncoder::with_frame_info(blocks, Vec::new());
        encoder.write_all(bytes).expect("memory");
        encoder.finish().expect("memory")
    }

    #[test]
    fn what_other_libraries_packed_is_unpacked() {
        for packed in [ZSTD_OF_OTHERS, LZ4_OF_OTHERS] {
            assert_eq!(any(packed, 2000).expect("packed").whole(), Ok(text()));
        }
        assert_eq!(any(b"PARAM", 2000), None);
    }

    /// Two frames, and between them a skippable frame with its length.
    #[test]
    fn frame_after_frame_is_unpacked() {
        let skipped = [0x50, 0x2A, 0x4D, 0x18, 3, 0, 0, 0, 9, 9, 9];
        for pack in [zstd_of, lz4_of] {
            let packed = [&pack(b"one,")[..], &skipped, &pack(b"two")].concat();
            let out = if packed.starts_with(ZSTD) { zstd } else { lz4 }(&packed, 7);
            assert_eq!(out.whole(), Ok(b"one,two".to_vec()));
        }
    }

    /// A mebibyte of zeros in less than 50 kB, with a limit of 1000 bytes.
    #[test]
    fn what_unpacks_to_more_than_the_limit_is_refused() {
        let zeros = vec![0; 1 << 20];
        for packed in [zstd_of(&zeros), lz4_of(&zeros)] {
            assert!(packed.len() < 50_000, "{}", packed.len());
            let out = any(&packed, 1000).expect("packed");
            assert!(out.bytes.is_empty());
            assert_eq!(
                out.error.as_deref(),
                Some("unpacks to more than 1000 bytes")
            );
        }
    }

    /// Of 400 kB of incompressible data, half of the file gives half of the data. zstd gives less,
    /// because its decoder keeps the part to which later bytes may refer.
    #[test]
    fn what_is_before_a_cut_is_kept() {
        let mut rng = emulators::rng::Rng::stream(1, "test.unpack");
        let mut byte = || u8::try_from(rng.below(256)).expect("below 256");
        let noise: Vec<u8> = (0..400_000).map(|_| byte()).collect();
        for (packed, least) in [(zstd_of(&noise), 0), (lz4_of(&noise), 130_000)] {
            let out = any(&packed[..packed.len() / 2], BYTES_MAX).expect("packed");
            assert!(out.error.is_some());
            assert!(noise.starts_with(&out.bytes) && out.bytes.len() >= least);
        }
    }
}
