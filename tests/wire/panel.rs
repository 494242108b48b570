//! Touch panel: frames by a slow reference method; frames in both directions by hand.

use proptest::collection::vec;
use proptest::prelude::*;
use protocols::panel::{
    self, Command, Contact, FRAME_MAX, Frame, PAYLOAD_MAX, PEN_LEN, Pen, Window, encode_pen,
    encode_pixels, encode_switch,
};
use protocols::{Decode, Decoder, FrameError};

use crate::hex;
use crate::protocol::{Protocol, Wire};

/// CRC-16/XMODEM bit by bit, as the catalogue defines it.
fn crc(bytes: &[u8]) -> u16 {
    let mut register = 0_u32;
    for byte in bytes {
        register ^= u32::from(*byte) << 8;
        for _ in 0..8 {
            register <<= 1;
            if register & 0x1_0000 != 0 {
                register ^= 0x1_1021;
            }
        }
    }
    u16::try_from(register).expect("sixteen bits")
}

fn frame_of_at_most(most: usize, bytes: &[u8]) -> Option<usize> {
    let &[0x7E, _, high, low, ..] = bytes else {
        return None;
    };
    let end = 4 + usize::from(high) * 256 + usize::from(low);
    let sum = bytes.get(end..end + 2)?;
    (end + 2 <= most && sum == crc(&bytes[1..end]).to_be_bytes()).then_some(end + 2)
}

impl<const N: usize> Wire for Frame<N> {
    fn wire(&self) -> Vec<u8> {
        self.as_bytes().to_vec()
    }
}

/// Frames to the panel.
pub(crate) struct Commands;

impl Protocol for Commands {
    type Decoder = panel::Decoder;

    const TELLING: &'static [u8] = &[0x7E, 0x29, 0x28, 0x2C, 0xE0, 0x00];
    const CASES: u32 = 1000;

    fn decoder() -> Self::Decoder {
        panel::Decoder::default()
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        frame_of_at_most(FRAME_MAX, bytes)
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        let drawn = (vec(0_u16..4, 1..30), 0_u16..450, 0_u16..272).prop_map(|(pixels, x, y)| {
            let width = u16::try_from(pixels.len()).expect("a few");
            let window = Window {
                columns: [x, x + width - 1],
                rows: [y, y],
            };
            let mut frame = vec![0; FRAME_MAX];
            let len = encode_pixels(window, &pixels, &mut frame).expect("fits");
            frame.truncate(len);
            frame
        });
        prop_oneof![
            1 => Just(encode_switch(panel::ON).to_vec()),
            5 => drawn,
        ]
        .boxed()
    }
}

/// Frames from the panel.
pub(crate) struct Reports;

impl Protocol for Reports {
    type Decoder = panel::PenDecoder;

    const TELLING: &'static [u8] = &[0x7E, 0x54, 0x00, 0x05];

    fn decoder() -> Self::Decoder {
        panel::PenDecoder::default()
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        frame_of_at_most(PEN_LEN, bytes)
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        (any::<bool>(), 0_u16..4096, 0_u16..4096)
            .prop_map(|(down, x, y)| {
                let contact = if down { Contact::Down } else { Contact::Up };
                let reading = [x, y];
                encode_pen(Pen { contact, reading }).to_vec()
            })
            .boxed()
    }
}

fn only(bytes: &[u8]) -> Frame {
    let mut decoder = panel::Decoder::default();
    let frames: Vec<_> = decoder.push(bytes).collect();
    let [Ok(frame)] = &frames[..] else {
        panic!("{frames:?}")
    };
    frame.clone()
}

fn sealed(text: &str) -> Vec<u8> {
    let mut bytes = hex(text);
    let sum = crc(&bytes[1..]);
    bytes.extend(sum.to_be_bytes());
    bytes
}

/// Windows as the common controllers take them: here x is 1 to 3 and y is 258 (01 02).
#[test]
fn a_window_is_columns_and_rows_with_both_corners() {
    let bytes = sealed("7E 2C 00 0E 00 01 01 02 00 03 01 02 F8 00 07 E0 00 1F");
    let window = Window {
        columns: [1, 3],
        rows: [258, 258],
    };
    let pixels = hex("F8 00 07 E0 00 1F");
    assert_eq!(
        only(&bytes).command(),
        Some(Command::Write(window, &pixels))
    );
    assert_eq!(window.area(), 3);
    let mut frame = [0xA5; FRAME_MAX];
    let len = encode_pixels(window, &[0xF800, 0x07E0, 0x001F], &mut frame);
    assert_eq!(frame[..len.expect("fits")], bytes);
}

/// Runs of at most 255: a row of 480 equal pixels is 255 and 225.
#[test]
fn long_runs_are_cut_at_255() {
    let bytes = sealed("7E E0 00 0E 00 00 00 00 01 DF 00 00 FF FF FF E1 FF FF");
    let window = Window {
        columns: [0, 479],
        rows: [0, 0],
    };
    let mut frame = [0xA5; FRAME_MAX];
    let len = encode_pixels(window, &[0xFFFF; 480], &mut frame).expect("fits");
    assert_eq!(frame[..len], bytes);
}

#[test]
fn the_longest_row_fits_one_frame() {
    let pixels: Vec<u16> = (0..480).collect();
    let window = Window {
        columns: [0, 479],
        rows: [0, 0],
    };
    let mut frame = [0; FRAME_MAX];
    let len = encode_pixels(window, &pixels, &mut frame);
    assert_eq!(len, Some(FRAME_MAX));
    assert_eq!(only(&frame).payload().len(), PAYLOAD_MAX);
}

#[test]
fn a_length_beyond_the_longest_frame_is_refused_at_once() {
    let mut decoder: Decoder<_, FRAME_MAX> = panel::Decoder::default();
    let errors: Vec<_> = decoder.push(&hex("7E 2C 03 C9")).collect();
    let expected = FrameError::Length {
        max: 968,
        found: 969,
    };
    assert_eq!(errors, [Err(expected)]);
}

/// A reading of more than twelve bits, a third state of the pen and odd pixels are not messages.
#[test]
fn what_has_no_meaning_is_not_given_one() {
    assert_eq!(only(&sealed("7E 54 00 05 01 10 00 00 00")).pen(), None);
    assert_eq!(only(&sealed("7E 54 00 05 02 00 00 00 00")).pen(), None);
    assert_eq!(only(&sealed("7E 29 00 01 00")).command(), None);
    let odd = "7E 2C 00 09 00 00 00 00 00 00 00 00 FF";
    assert_eq!(only(&sealed(odd)).command(), None);
}
