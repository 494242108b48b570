//! Run-length code of the map rows: pairs of count and value.
//!
//! The sound encoder counts every pixel. The fielded one never counts the last pixel of a row: its
//! counts sum to one less than the row, and a last pixel that differs is lost. The code itself does
//! not show its encoder, so a decoder must know the row's width.
//!
//! Source: seed report 2015, chapter on the PC link; the loss was seen by running the fielded code.

/// Rule of an encoder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dialect {
    /// Every pixel is counted.
    #[default]
    Lossless,
    /// The fielded rule: the last pixel is never counted.
    Fielded,
}

/// Encodes `pixels` into `out` and returns the number of bytes, or `None` if `out` is too small.
/// An empty row is no bytes.
pub fn encode(pixels: &[u8], dialect: Dialect, out: &mut [u8]) -> Option<usize> {
    let counted = match dialect {
        Dialect::Lossless => pixels,
        Dialect::Fielded => &pixels[..pixels.len().saturating_sub(1)],
    };
    let mut len = 0;
    for run in counted.chunk_by(|a, b| a == b) {
        for part in run.chunks(usize::from(u8::MAX)) {
            let pair = out.get_mut(len..len + 2)?;
            pair[0] = u8::try_from(part.len()).expect("chunks of at most 255");
            pair[1] = part[0];
            len += 2;
        }
    }
    Some(len)
}

/// Error of an invalid coded row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RleError {
    /// A count without its value.
    OddLength,
    /// The counts sum to more than the row holds.
    TooLong {
        /// Pixels in the row.
        width: usize,
    },
}

impl core::fmt::Display for RleError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::OddLength => f.write_str("run-length row ends with a count that has no value"),
            Self::TooLong { width } => write!(f, "run-length row is longer than {width} pixels"),
        }
    }
}

impl core::error::Error for RleError {}

/// Decodes `code` into the front of `row` and returns the number of pixels written; the rest of
/// `row` stays. A row of the fielded dialect writes one pixel less than its width.
pub fn decode(code: &[u8], row: &mut [u8]) -> Result<usize, RleError> {
    let (pairs, []) = code.as_chunks::<2>() else {
        return Err(RleError::OddLength);
    };
    let pixels: usize = pairs.iter().map(|&[count, _]| usize::from(count)).sum();
    if pixels > row.len() {
        return Err(RleError::TooLong { width: row.len() });
    }
    let mut at = 0;
    for &[count, value] in pairs {
        let end = at + usize::from(count);
        row[at..end].fill(value);
        at = end;
    }
    Ok(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The fielded program's row of 300 unknown cells: `FF 7F 2C 7F`, 299 pixels.
    #[test]
    fn the_fielded_rule_loses_the_last_pixel() {
        let mut code = [0; 8];
        let len = encode(&[127; 300], Dialect::Fielded, &mut code).expect("fits");
        assert_eq!(code[..len], [0xFF, 0x7F, 0x2C, 0x7F]);
        assert_eq!(decode(&code[..len], &mut [0; 300]), Ok(299));
    }

    #[test]
    fn the_sound_rule_counts_every_pixel() {
        let mut code = [0; 8];
        let len = encode(&[127; 300], Dialect::Lossless, &mut code).expect("fits");
        assert_eq!(code[..len], [0xFF, 0x7F, 0x2D, 0x7F]);
        assert_eq!(decode(&code[..len], &mut [0; 300]), Ok(300));
    }

    #[test]
    fn a_row_that_is_too_long_leaves_the_target_alone() {
        let mut row = [9; 4];
        assert_eq!(
            decode(&[5, 1], &mut row),
            Err(RleError::TooLong { width: 4 })
        );
        assert_eq!(decode(&[1], &mut row), Err(RleError::OddLength));
        assert_eq!(row, [9; 4]);
    }

    /// The code has two pixels of 9, none of 5 and three of 127; the last pixel of the row stays as
    /// it was.
    #[test]
    fn each_run_follows_the_one_before_it() {
        let mut row = [1; 6];
        assert_eq!(decode(&[2, 9, 0, 5, 3, 127], &mut row), Ok(5));
        assert_eq!(row, [9, 9, 127, 127, 127, 1]);
    }

    #[test]
    fn errors_tell_what_is_wrong() {
        extern crate std;
        let odd = std::format!("{}", RleError::OddLength);
        assert_eq!(odd, "run-length row ends with a count that has no value");
        let long = std::format!("{}", RleError::TooLong { width: 4 });
        assert_eq!(long, "run-length row is longer than 4 pixels");
    }
}
