//! Portable gray and pixel maps: `P2` and `P3` in decimal figures, `P5` and `P6` in bytes.
//!
//! ```text
//! P5 # a comment may follow any word of the head, to the end of its line
//! WIDTH HEIGHT MAXVAL, one white space, then the rows from the top
//! ```

use std::io::{BufRead, Bytes, Read};

use super::{Picture, PictureError, Pixel, narrow, sized};

/// Digits and white space of the longest number: 4294967295.
const DIGITS_MAX: usize = 10;

pub(super) fn read<P: Pixel>(
    file: impl BufRead,
    pixels_max: usize,
) -> Result<Picture<P>, PictureError> {
    let mut input = Input(file.bytes());
    input.byte()?;
    let form = input.byte()?;
    let (is_text, is_gray) = (matches!(form, b'2' | b'3'), matches!(form, b'2' | b'5'));
    let mut head = || Ok(input.number()? as usize);
    let (width, height) = (head()?, head()?);
    let most = input.number()?;
    let count = sized(width, height, pixels_max)?;
    if !(1..=65535).contains(&most) {
        return Err(wrong(format!(
            "the largest value is {most}, expected 1 to 65535"
        )));
    }
    // The memory grows with the actual content of the file, not with the announced size.
    let mut pixels = Vec::new();
    for _ in 0..count {
        let mut sample = || {
            let value = match (is_text, most > 255) {
                (true, _) => input.number()?,
                (false, true) => u32::from(u16::from_be_bytes([input.byte()?, input.byte()?])),
                (false, false) => input.byte()?.into(),
            };
            Ok(scaled(value, most))
        };
        pixels.push(if is_gray {
            P::from_gray(sample()?)
        } else {
            P::from_rgb([sample()?, sample()?, sample()?])
        });
    }
    Ok(Picture {
        width,
        height,
        pixels,
    })
}

/// `value` of `most`, scaled to eight bits and rounded; larger values are white.
fn scaled(value: u32, most: u32) -> u8 {
    let value = u64::from(value.min(most));
    let to = |full: u64| (value * full + u64::from(most) / 2) / u64::from(most);
    // A file with more than eight bits is converted over sixteen bits, like PNG.
    if most > 255 {
        narrow(u16::try_from(to(65535)).expect("at most all of it"))
    } else {
        u8::try_from(to(255)).expect("at most all of it")
    }
}

fn wrong(what: String) -> PictureError {
    PictureError::Form(what)
}

struct Input<R>(Bytes<R>);

impl<R: Read> Input<R> {
    fn byte(&mut self) -> Result<u8, PictureError> {
        match self.0.next() {
            Some(Ok(byte)) => Ok(byte),
            Some(Err(error)) => Err(wrong(error.to_string())),
            None => Err(wrong("ends before its last pixel".to_owned())),
        }
    }

    /// The next number, and one byte of white space after it. The file may end with the number.
    fn number(&mut self) -> Result<u32, PictureError> {
        let mut digits = String::new();
        loop {
            let byte = match self.byte() {
                Err(_) if !digits.is_empty() => b' ',
                byte => byte?,
            };
            match byte {
                b'#' => while !matches!(self.byte()?, b'\n' | b'\r') {},
                b'0'..=b'9' if digits.len() < DIGITS_MAX => digits.push(byte.into()),
                b' ' | b'\t' | b'\n' | b'\r' | 0x0B | 0x0C if digits.is_empty() => {}
                b' ' | b'\t' | b'\n' | b'\r' | 0x0B | 0x0C => break,
                _ => {
                    return Err(wrong(format!(
                        "byte {byte:#04x} is unexpected here, expected a number"
                    )));
                }
            }
        }
        let number = digits.parse();
        number.map_err(|_| wrong(format!("{digits} is no number of pixels or grays")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(bytes: &[u8]) -> Result<Vec<u8>, String> {
        let picture = read::<u8>(bytes, 6);
        picture
            .map(|picture| picture.pixels)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn all_four_forms_are_read() {
        assert_eq!(gray(b"P5\n3 1\n255\n\x00\xCD\xFE"), Ok(vec![0, 205, 254]));
        assert_eq!(gray(b"P2 3 1 255 0 205\n 254"), Ok(vec![0, 205, 254]));
        assert_eq!(
            gray(b"P6\n2 1\n255\n\xCD\xCD\xCD\x0A\x14\x1E"),
            Ok(vec![205, 19])
        );
        assert_eq!(
            gray(b"P3\n2 1\n255\n205 205 205\n10 20 30\n"),
            Ok(vec![205, 19])
        );
        let colours = read::<[u8; 3]>(&b"P3 1 1 255 10 20 30"[..], 1).expect("sound");
        assert_eq!(colours.pixels, [[10, 20, 30]]);
    }

    /// GIMP and map_saver write a comment after the magic number.
    #[test]
    fn comments_are_passed_over() {
        let text = b"P5\n# CREATOR: map_saver 0.050 m/pix\n2 # width\n#\n1\n#P2\n255\n#\xCD";
        assert_eq!(gray(text), Ok(vec![b'#', 205]));
        assert_eq!(gray(b"P2\n2 1\n255\n#\n1 # one\r2"), Ok(vec![1, 2]));
    }

    /// White is the file's own largest value; sixteen bits have the high byte first.
    #[test]
    fn values_are_scaled_to_eight_bits() {
        let wide = b"P5 4 1 65535\n\x00\x7F\x00\x81\xCD\xCD\xFF\xFF";
        assert_eq!(gray(wide), Ok(vec![0, 1, 205, 255]));
        assert_eq!(gray(b"P2 4 1 15 0 5 10 15"), Ok(vec![0, 85, 170, 255]));
        assert_eq!(gray(b"P2 3 1 1000 0 500 1000"), Ok(vec![0, 128, 255]));
        assert_eq!(gray(b"P5 2 1 100 \xFF\x32"), Ok(vec![255, 128]));
    }

    #[test]
    fn what_is_cut_off_or_no_map_is_an_error() {
        let short = "ends before its last pixel";
        for bytes in [
            &b"P5"[..],
            b"P5 2",
            b"P5 2 1 255 \x01",
            b"P2 2 1 255 1 ",
            b"P6 1 1 255 ab",
        ] {
            assert_eq!(gray(bytes).expect_err("cut off"), short);
        }
        assert_eq!(
            gray(b"P5 3 3 255 ").expect_err("9 of 6"),
            "has 3 x 3 pixels"
        );
        assert_eq!(gray(b"P5 0 3 255 ").expect_err("none"), "has 0 x 3 pixels");
        let error = gray(b"P5 4294967295 4294967295 255 ").expect_err("huge");
        assert_eq!(error, "has 4294967295 x 4294967295 pixels");
        let error = gray(b"P5 1 1 65536 ").expect_err("too many bits");
        assert_eq!(error, "the largest value is 65536, expected 1 to 65535");
        let error = gray(b"P2 -1 1 255 ").expect_err("negative");
        assert_eq!(error, "byte 0x2d is unexpected here, expected a number");
        let error = gray(b"P2 9999999999 1 255 ").expect_err("overflow");
        assert_eq!(error, "9999999999 is no number of pixels or grays");
    }
}
