//! Laws of the formats without frames: coded map rows, and the radio's commands.

use protocols::hc06::{Command, LineCommand};
use protocols::rle::{self, Dialect};

use super::{Broken, Stream};

/// Width of a map row.
const WIDTH: usize = 300;

/// A coded row is rejected with a message, or decodes to pixels that are the same after encoding
/// and decoding. The same bytes, used as pixels, are also the same after encoding and decoding.
pub(super) fn rows_survive_their_code(stream: &Stream) -> Result<(), Broken> {
    let mut row = [0; WIDTH];
    if let Ok(len) = rle::decode(stream.bytes(), &mut row) {
        comes_back(&row[..len])?;
    }
    let pixels = &stream.bytes()[..stream.bytes().len().min(WIDTH)];
    comes_back(pixels)
}

fn comes_back(pixels: &[u8]) -> Result<(), Broken> {
    for (dialect, lost) in [(Dialect::Lossless, 0), (Dialect::Fielded, 1)] {
        let expected = &pixels[..pixels.len().saturating_sub(lost)];
        let (mut code, mut row) = ([0; 2 * WIDTH], [0; WIDTH]);
        let len = rle::encode(pixels, dialect, &mut code);
        let decoded = len.map(|len| rle::decode(&code[..len], &mut row));
        if decoded != Some(Ok(expected.len())) || &row[..expected.len()] != expected {
            let detail = format!("{dialect:?}: {pixels:?} came back as {decoded:?}");
            return Err(Broken::new("rows-survive-their-code", detail));
        }
    }
    Ok(())
}

/// A parsed command encodes to the same bytes. For the line-terminated family with its several
/// spellings, the encoded command parses to the same command.
pub(super) fn commands_are_said_as_heard(stream: &Stream) -> Result<(), Broken> {
    let bytes = stream.bytes();
    let mut said = [0; 128];
    if let Some(command) = Command::parse(bytes) {
        let len = command.encode(&mut said).unwrap_or(0);
        if &said[..len] != bytes {
            let detail = format!(
                "{command:?} is encoded as \"{}\"",
                said[..len].escape_ascii()
            );
            return Err(Broken::new("commands-are-said-as-heard", detail));
        }
    }
    if let Some(command) = LineCommand::parse(bytes) {
        let len = command.encode(&mut said).unwrap_or(0);
        let line = said[..len].strip_suffix(b"\r\n").unwrap_or_default();
        if LineCommand::parse(line) != Some(command) {
            let detail = format!("{command:?} is encoded as \"{}\"", line.escape_ascii());
            return Err(Broken::new("commands-are-said-as-heard", detail));
        }
    }
    Ok(())
}
