//! Run-length code of the map rows, against the fielded rule written out step by step.

use proptest::collection::vec;
use proptest::prelude::*;
use protocols::rle::{self, Dialect, RleError};

use crate::hex;

/// Rows as in maps: few values, long runs, some of them longer than a count can hold.
pub(crate) fn row(
    width: impl Into<proptest::collection::SizeRange>,
) -> impl Strategy<Value = Vec<u8>> {
    let width = width.into();
    let value = proptest::sample::select(&[0_u8, 127, 255][..]);
    let run = prop_oneof![1_usize..4, 1_usize..40, 250_usize..260];
    (vec((value, run), 1..160), vec(any::<u8>(), width)).prop_map(|(runs, filler)| {
        let mut row: Vec<u8> = runs
            .into_iter()
            .flat_map(|(value, run)| vec![value; run])
            .collect();
        row.truncate(filler.len());
        row.extend(&filler[row.len()..]);
        row
    })
}

fn encoded(pixels: &[u8], dialect: Dialect) -> Vec<u8> {
    let mut code = vec![0xA5; 2 * pixels.len()];
    let len = rle::encode(pixels, dialect, &mut code).expect("two bytes a pixel always suffice");
    code.truncate(len);
    code
}

/// The fielded rule, as in the field program e94332f. The current run is written at every pixel
/// that differs from the one before, at the last pixel, and when the count is full; only then is
/// the pixel counted. So the last pixel is never counted.
fn fielded_slowly(pixels: &[u8]) -> Vec<u8> {
    let mut code = Vec::new();
    let (mut value, mut count) = (pixels[0], 0_u8);
    for (i, &pixel) in pixels.iter().enumerate() {
        if pixel != value || i == pixels.len() - 1 || count == 255 {
            code.extend([count, value]);
            (value, count) = (pixel, 0);
        }
        count += 1;
    }
    code
}

/// By hand: 255 + 45 and 255 + 44 unknown cells; a wall of one cell in free space.
#[test]
fn rows_have_their_codes() {
    assert_eq!(encoded(&[127; 300], Dialect::Lossless), hex("FF 7F 2D 7F"));
    assert_eq!(encoded(&[127; 300], Dialect::Fielded), hex("FF 7F 2C 7F"));
    let wall = [[0; 4].as_slice(), &[255], &[0; 2]].concat();
    assert_eq!(encoded(&wall, Dialect::Lossless), hex("04 00 01 FF 02 00"));
    assert_eq!(encoded(&wall, Dialect::Fielded), hex("04 00 01 FF 01 00"));
}

/// Loss by the fielded rule: a last pixel that differs keeps its old value.
#[test]
fn a_differing_last_pixel_is_lost_by_the_fielded_rule_only() {
    let mut pixels = [0; 300];
    pixels[299] = 255;
    let mut row = [127; 300];
    assert_eq!(
        rle::decode(&encoded(&pixels, Dialect::Fielded), &mut row),
        Ok(299)
    );
    assert_eq!((row[298], row[299]), (0, 127));
    assert_eq!(
        rle::decode(&encoded(&pixels, Dialect::Lossless), &mut row),
        Ok(300)
    );
    assert_eq!((row[298], row[299]), (0, 255));
}

/// The bounds of the count byte: 255 is one run, 256 are two.
#[test]
fn a_run_of_256_takes_two_pairs() {
    assert_eq!(encoded(&[9; 255], Dialect::Lossless), hex("FF 09"));
    assert_eq!(encoded(&[9; 256], Dialect::Lossless), hex("FF 09 01 09"));
    assert_eq!(
        encoded(&[9; 511], Dialect::Lossless),
        hex("FF 09 FF 09 01 09")
    );
}

proptest! {
    #![proptest_config(crate::thorough::cases(8000))]

    #[test]
    fn the_sound_rule_loses_nothing(pixels in row(0..=600)) {
        let mut decoded = vec![0xA5; pixels.len()];
        let code = encoded(&pixels, Dialect::Lossless);
        prop_assert_eq!(rle::decode(&code, &mut decoded), Ok(pixels.len()));
        prop_assert_eq!(decoded, pixels);
    }

    #[test]
    fn the_fielded_rule_is_the_fielded_program(pixels in row(2..=600)) {
        prop_assert_eq!(encoded(&pixels, Dialect::Fielded), fielded_slowly(&pixels));
    }

    /// Any bytes are either a row that fits or are refused without touching the target.
    #[test]
    fn any_code_is_a_row_or_refused(code in vec(any::<u8>(), 0..12), width in 0_usize..600) {
        let mut row = vec![0xA5; width];
        let sum: usize = code.chunks_exact(2).map(|pair| usize::from(pair[0])).sum();
        let result = rle::decode(&code, &mut row);
        let expected = if code.len() % 2 == 1 {
            Err(RleError::OddLength)
        } else if sum > width {
            Err(RleError::TooLong { width })
        } else {
            Ok(sum)
        };
        prop_assert_eq!(result, expected);
        let written = result.unwrap_or(0);
        prop_assert!(row[written..].iter().all(|&pixel| pixel == 0xA5));
    }

    /// If the target is too small, the encoder reports it and never writes past the end.
    #[test]
    fn a_code_that_does_not_fit_is_refused(pixels in row(1..=40), space in 0_usize..80) {
        let needed = encoded(&pixels, Dialect::Lossless).len();
        let mut out = vec![0; space];
        let len = rle::encode(&pixels, Dialect::Lossless, &mut out);
        prop_assert_eq!(len, (needed <= space).then_some(needed));
    }
}
