//! PNG: reads all formats of the standard; writes eight bits of red, green and blue.

use std::io::{self, BufRead, Seek, Write};

use png::{BitDepth, ColorType, Compression, Decoder, Encoder, Limits, Transformations};

use super::{Picture, PictureError, Pixel, narrow, sized};

/// Maximum memory of the decoder for chunks besides the pixels, bytes.
const SIDE_BYTES_MAX: usize = 64 << 20;

pub(super) fn read<P: Pixel>(
    file: impl BufRead + Seek,
    pixels_max: usize,
) -> Result<Picture<P>, PictureError> {
    let form = |error: png::DecodingError| PictureError::Form(error.to_string());
    let mut decoder = Decoder::new_with_limits(
        file,
        Limits {
            bytes: SIDE_BYTES_MAX,
        },
    );
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    // Palettes become colours, 1, 2 and 4 bits become 8.
    decoder.set_transformations(Transformations::EXPAND);
    let info = decoder.read_header_info().map_err(form)?;
    let (width, height) = (info.width as usize, info.height as usize);
    sized(width, height, pixels_max)?;
    let mut reader = decoder.read_info().map_err(form)?;
    let too_large = || PictureError::Size { width, height };
    let mut samples = vec![0; reader.output_buffer_size().ok_or_else(too_large)?];
    reader.next_frame(&mut samples).map_err(form)?;
    let (colour, depth) = reader.output_color_type();
    if depth == BitDepth::Sixteen {
        let wide = samples.as_chunks::<2>().0.iter();
        samples = wide.map(|wide| narrow(u16::from_be_bytes(*wide))).collect();
    }
    let pixels = samples.chunks(colour.samples());
    let pixels = pixels.map(|samples| match *samples {
        [red, green, blue, ..] => P::from_rgb([red, green, blue]),
        [gray, ..] => P::from_gray(gray),
        [] => unreachable!("chunks are not empty"),
    });
    Ok(Picture {
        width,
        height,
        pixels: pixels.collect(),
    })
}

pub(super) fn write(picture: &Picture, file: impl Write) -> io::Result<()> {
    let size = |pixels: usize| u32::try_from(pixels).map_err(io::Error::other);
    let mut encoder = Encoder::new(
        io::BufWriter::new(file),
        size(picture.width)?,
        size(picture.height)?,
    );
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    // To choose the best filter of each row would take longer than writing all other files of a
    // run.
    encoder.set_compression(Compression::Fastest);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(picture.pixels.as_flattened())?;
    Ok(writer.finish()?)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// A file of 4 x 1 pixels.
    fn file(
        colour: ColorType,
        depth: BitDepth,
        data: &[u8],
        more: impl FnOnce(&mut Encoder<&mut Vec<u8>>),
    ) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, 4, 1);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        more(&mut encoder);
        let mut writer = encoder.write_header().expect("sound");
        writer.write_image_data(data).expect("4 pixels");
        writer.finish().expect("to memory");
        bytes
    }

    fn grays(bytes: &[u8]) -> Vec<u8> {
        let picture = read::<u8>(Cursor::new(bytes), 4).expect("sound");
        assert_eq!((picture.width, picture.height), (4, 1));
        picture.pixels
    }

    /// Each bit depth has its own largest value, which is white.
    #[test]
    fn grays_of_any_depth_become_eight_bits() {
        let gray = |depth, data: &[u8]| grays(&file(ColorType::Grayscale, depth, data, |_| ()));
        assert_eq!(gray(BitDepth::One, &[0b0101_0000]), [0, 255, 0, 255]);
        assert_eq!(gray(BitDepth::Two, &[0b0001_1011]), [0, 85, 170, 255]);
        assert_eq!(gray(BitDepth::Four, &[0x05, 0xAF]), [0, 85, 170, 255]);
        assert_eq!(
            gray(BitDepth::Eight, &[0, 205, 254, 255]),
            [0, 205, 254, 255]
        );
        let wide = [0x00, 0x7F, 0x00, 0x81, 0xCD, 0xCD, 0xFF, 0xFF];
        assert_eq!(gray(BitDepth::Sixteen, &wide), [0, 1, 205, 255]);
    }

    /// A gray of three equal parts does not change.
    #[test]
    fn colours_become_their_brightness() {
        let parts = [0, 0, 0, 205, 205, 205, 10, 20, 30, 255, 255, 255];
        let rgb = file(ColorType::Rgb, BitDepth::Eight, &parts, |_| ());
        assert_eq!(grays(&rgb), [0, 205, 19, 255]);
        let colours = read::<[u8; 3]>(Cursor::new(&rgb), 4).expect("sound");
        assert_eq!(colours.pixels.as_flattened(), parts);
        let wide: Vec<u8> = parts.iter().flat_map(|part| [*part; 2]).collect();
        let wide = file(ColorType::Rgb, BitDepth::Sixteen, &wide, |_| ());
        assert_eq!(grays(&wide), [0, 205, 19, 255]);
        let indexed = file(
            ColorType::Indexed,
            BitDepth::Two,
            &[0b1110_0100],
            |encoder| {
                encoder.set_palette(parts.to_vec());
            },
        );
        assert_eq!(grays(&indexed), [255, 19, 205, 0]);
    }

    /// As in the map server's trinary mode: transparency is ignored, so a transparent wall is a
    /// wall.
    #[test]
    fn what_is_let_through_keeps_its_gray() {
        let with = [0, 0, 205, 9, 254, 128, 255, 255];
        let gray = file(ColorType::GrayscaleAlpha, BitDepth::Eight, &with, |_| ());
        assert_eq!(grays(&gray), [0, 205, 254, 255]);
        let with = [
            0, 0, 0, 0, 205, 205, 205, 9, 10, 20, 30, 128, 255, 255, 255, 255,
        ];
        let rgba = file(ColorType::Rgba, BitDepth::Eight, &with, |_| ());
        assert_eq!(grays(&rgba), [0, 205, 19, 255]);
        let indexed = file(
            ColorType::Indexed,
            BitDepth::Two,
            &[0b0100_0100],
            |encoder| {
                encoder.set_palette(vec![0, 0, 0, 205, 205, 205]);
                encoder.set_trns(vec![0, 9]);
            },
        );
        assert_eq!(grays(&indexed), [205, 0, 205, 0]);
    }

    #[test]
    fn what_is_cut_off_damaged_or_huge_is_an_error() {
        let whole = file(ColorType::Grayscale, BitDepth::Eight, &[1, 2, 3, 4], |_| ());
        for len in 8..whole.len() - 12 {
            let error = read::<u8>(Cursor::new(&whole[..len]), 4).expect_err("cut off");
            assert!(matches!(error, PictureError::Form(_)), "{len}: {error}");
        }
        let error = read::<u8>(Cursor::new(&whole), 3).expect_err("too large");
        assert_eq!(error.to_string(), "has 4 x 1 pixels");
        let mut damaged = whole;
        damaged[45] ^= 1;
        read::<u8>(Cursor::new(&damaged), 4).expect_err("damaged");
    }

    #[test]
    fn what_is_written_is_read_again() {
        let picture = Picture::from_fn(70, 30, |x, y| {
            [x, y, x * y].map(|part| part.to_le_bytes()[0])
        });
        let mut bytes = Vec::new();
        write(&picture, &mut bytes).expect("to memory");
        let again = read::<[u8; 3]>(Cursor::new(&bytes), 2100).expect("sound");
        assert_eq!(again, picture);
        let nothing = Picture::from_fn(0, 3, |_, _| [0; 3]);
        write(&nothing, &mut Vec::new()).expect_err("no pixel");
    }
}
