//! Pictures as plain data: output of maps and displays, input of floor plans.
//!
//! ```text
//! Grid, TouchPanel --> Picture --> PNG, PGM        PNG, PGM, PPM --> Picture --> walls
//! ```
//!
//! Two formats are enough, so the tool needs no general image library: PNG through the crate `png`,
//! and the portable maps of `picture/pnm.rs`, the format of ROS maps.

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

#[cfg(feature = "pictures")]
mod png;
mod pnm;

/// Rows of pixels, the top one first. Red, green and blue by default; `u8` is gray, 0 black.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture<P = [u8; 3]> {
    width: usize,
    height: usize,
    pixels: Vec<P>,
}

/// A pixel type that can be made from gray or colour.
pub trait Pixel: Copy {
    /// The pixel of a gray value, 0 black.
    fn from_gray(gray: u8) -> Self;
    /// The pixel of red, green and blue.
    fn from_rgb(rgb: [u8; 3]) -> Self;
}

impl Pixel for u8 {
    fn from_gray(gray: u8) -> Self {
        gray
    }

    /// The brightness of ITU-R BT.709, to the nearest.
    fn from_rgb(rgb: [u8; 3]) -> Self {
        let parts = rgb.iter().zip([2126, 7152, 722]);
        let sum: u32 = parts.map(|(part, weight)| u32::from(*part) * weight).sum();
        Self::try_from((sum + 5000) / 10_000).expect("a mean of three bytes")
    }
}

impl Pixel for [u8; 3] {
    fn from_gray(gray: u8) -> Self {
        [gray; 3]
    }

    fn from_rgb(rgb: Self) -> Self {
        rgb
    }
}

/// Eight bits of sixteen, to the nearest, so that white stays white.
fn narrow(wide: u16) -> u8 {
    u8::try_from((u32::from(wide) + 128) / 257).expect("65535 becomes 255")
}

/// A file without a picture, or with an unsuitable one.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The file cannot be opened.
    #[error(transparent)]
    Open(io::Error),
    /// The picture has no pixel, or more than allowed.
    #[error("has {width} x {height} pixels")]
    Size {
        /// Pixels of a row.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The file is damaged or has another format; a sentence with the reason.
    #[error("{0}")]
    Form(String),
}

impl<P: Copy> Picture<P> {
    /// A picture with `pixel(x, y)` at column `x` and row `y`.
    pub fn from_fn(width: usize, height: usize, mut pixel: impl FnMut(usize, usize) -> P) -> Self {
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            pixels.extend((0..width).map(|x| pixel(x, y)));
        }
        Self {
            width,
            height,
            pixels,
        }
    }

    /// The picture magnified: each pixel `scale` times as wide and as high.
    #[must_use]
    pub fn magnified(&self, scale: usize) -> Self {
        let mut pixels = Vec::with_capacity(self.pixels.len() * scale * scale);
        for row in self.pixels.chunks(self.width.max(1)) {
            let from = pixels.len();
            let wide = row
                .iter()
                .flat_map(|&pixel| core::iter::repeat_n(pixel, scale));
            pixels.extend(wide);
            let to = pixels.len();
            (1..scale).for_each(|_| pixels.extend_from_within(from..to));
        }
        Self {
            width: self.width * scale,
            height: self.height * scale,
            pixels,
        }
    }

    /// Pixels of a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row after row from the top.
    pub fn pixels(&self) -> &[P] {
        &self.pixels
    }

    /// The pixel at column `x` and row `y`; `None` outside.
    pub fn get(&self, x: usize, y: usize) -> Option<P> {
        (x < self.width && y < self.height).then(|| self.pixels[y * self.width + x])
    }

    /// Paints the pixel at column `x` and row `y`; pixels outside are ignored.
    pub fn put(&mut self, x: usize, y: usize, pixel: P) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = pixel;
        }
    }

    /// All pixels, row after row from the lowest, as maps count them.
    pub fn from_below(&self) -> impl Iterator<Item = P> + '_ {
        let rows = self.pixels.chunks(self.width.max(1)).rev();
        rows.flatten().copied()
    }
}

impl<P: Pixel> Picture<P> {
    /// Reads a PNG, PGM or PPM file of at most `pixels_max` pixels. Its first bytes determine the
    /// format. Transparency is ignored.
    ///
    /// # Errors
    /// If the file does not exist or holds no picture of that size. The size is checked before any
    /// memory is allocated, because a damaged file may announce any size.
    pub fn read(path: &Path, pixels_max: usize) -> Result<Self, PictureError> {
        let mut file = BufReader::new(File::open(path).map_err(PictureError::Open)?);
        match file.fill_buf().map_err(PictureError::Open)? {
            [b'P', b'2' | b'3' | b'5' | b'6', ..] => pnm::read(file, pixels_max),
            #[cfg(feature = "pictures")]
            [0x89, b'P', b'N', b'G', ..] => png::read(file, pixels_max),
            #[cfg(not(feature = "pictures"))]
            [0x89, b'P', b'N', b'G', ..] => Err(PictureError::Form(
                "a PNG file, which needs hilrig's feature \"pictures\"; convert it to PGM"
                    .to_owned(),
            )),
            _ => Err(PictureError::Form("neither PNG nor PGM nor PPM".to_owned())),
        }
    }
}

#[cfg(feature = "pictures")]
impl Picture {
    /// The bytes of a PNG file.
    ///
    /// # Errors
    /// If the picture has no pixel.
    pub fn png(&self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        png::write(self, &mut bytes)?;
        Ok(bytes)
    }
}

impl Picture<u8> {
    /// The bytes of a binary PGM file.
    pub fn pgm(&self) -> Vec<u8> {
        let head = format!("P5\n{} {}\n255\n", self.width, self.height);
        [head.as_bytes(), &self.pixels].concat()
    }
}

/// The number of pixels announced by a file, if allowed.
fn sized(width: usize, height: usize, pixels_max: usize) -> Result<usize, PictureError> {
    let pixels = width.checked_mul(height);
    pixels
        .filter(|pixels| (1..=pixels_max).contains(pixels))
        .ok_or(PictureError::Size { width, height })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_counted_from_both_ends() {
        let mut picture = Picture::from_fn(3, 2, |x, y| u8::try_from(10 * y + x).expect("small"));
        picture.put(1, 0, 99);
        picture.put(3, 0, 77);
        assert_eq!(picture.pixels(), [0, 99, 2, 10, 11, 12]);
        assert_eq!(
            picture.from_below().collect::<Vec<_>>(),
            [10, 11, 12, 0, 99, 2]
        );
        assert_eq!((picture.get(2, 1), picture.get(3, 1)), (Some(12), None));
        assert_eq!(
            (picture.get(0, 2), picture.width(), picture.height()),
            (None, 3, 2)
        );
    }

    /// The form's own definition: magic, width, height, largest gray, one white space, the rows.
    #[test]
    fn a_gray_picture_is_a_binary_pgm() {
        let picture = Picture::from_fn(2, 1, |x, _| if x == 0 { 254 } else { 205 });
        assert_eq!(picture.pgm(), b"P5\n2 1\n255\n\xFE\xCD");
    }

    #[test]
    fn a_magnified_picture_has_squares_for_pixels() {
        let picture = Picture::from_fn(2, 2, |x, y| u8::try_from(10 * y + x).expect("small"));
        let large = picture.magnified(2);
        assert_eq!((large.width(), large.height()), (4, 4));
        let rows = [
            [0, 0, 1, 1],
            [0, 0, 1, 1],
            [10, 10, 11, 11],
            [10, 10, 11, 11],
        ];
        assert_eq!(large.pixels(), rows.as_flattened());
    }

    /// White stays white, and green is brighter than blue.
    #[test]
    fn colours_have_a_brightness() {
        let gray = |rgb| u8::from_rgb(rgb);
        assert_eq!([[0; 3], [255; 3], [10, 20, 30]].map(gray), [0, 255, 19]);
        assert_eq!(
            [[255, 0, 0], [0, 255, 0], [0, 0, 255]].map(gray),
            [54, 182, 18]
        );
    }

    #[test]
    fn sizes_are_judged_before_memory_is_taken() {
        assert_eq!(sized(3, 4, 12).expect("allowed"), 12);
        for (width, height) in [(0, 4), (3, 0), (13, 1), (usize::MAX, 2)] {
            let error = sized(width, height, 12).expect_err("not allowed");
            assert_eq!(error.to_string(), format!("has {width} x {height} pixels"));
        }
    }
}
