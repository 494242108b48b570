//! Conversion between the bytes on the wire and the content of a frame: markers, stuffing, digits.

use std::borrow::Cow;

use protocols::FrameError;

use super::{Cut, Framing};
use crate::schema::wire::Stuffing;

const SLIP_END: u8 = 0xC0;
const SLIP_ESC: u8 = 0xDB;
const SLIP_ESC_END: u8 = 0xDC;
const SLIP_ESC_ESC: u8 = 0xDD;
const HDLC_FLAG: u8 = 0x7E;
const HDLC_ESC: u8 = 0x7D;
pub(crate) const DLE: u8 = 0x10;
const STX: u8 = 0x02;
const ETX: u8 = 0x03;

impl Stuffing {
    /// The start marker and the end marker that the stuffing implies.
    pub(crate) const fn markers(self) -> Option<[&'static [u8]; 2]> {
        match self {
            Self::None => None,
            Self::Slip => Some([&[SLIP_END], &[SLIP_END]]),
            Self::Hdlc => Some([&[HDLC_FLAG], &[HDLC_FLAG]]),
            Self::Cobs => Some([&[], &[0]]),
            Self::Dle => Some([&[DLE, STX], &[DLE, ETX]]),
        }
    }

    /// The offset of the end marker `end` in the bytes behind a start marker, if it is there.
    pub(super) fn end(self, bytes: &[u8], end: &[u8]) -> Result<Option<usize>, FrameError> {
        match self {
            Self::Dle => dle_end(bytes, end),
            _ => Ok(find(bytes, end)),
        }
    }
}

impl Framing {
    /// The content of the complete frame `frame`.
    pub(crate) fn content<'a>(&self, frame: &'a [u8]) -> Result<Cow<'a, [u8]>, FrameError> {
        let Cut::Marked {
            start,
            end,
            stuffing,
            tail,
        } = &self.cut
        else {
            return Ok(Cow::Borrowed(frame));
        };
        let found = u32::try_from(frame.len()).unwrap_or(u32::MAX);
        let cut_off = FrameError::Truncated { found };
        let inner = frame.strip_prefix(&**start).unwrap_or(frame);
        let inner_len = inner.len().checked_sub(tail + end.len()).ok_or(cut_off)?;
        let content = match stuffing {
            Stuffing::None if *tail > 0 => {
                let mut all = inner[..inner_len].to_vec();
                all.extend_from_slice(&inner[inner_len + end.len()..]);
                Cow::Owned(all)
            }
            Stuffing::None => Cow::Borrowed(&inner[..inner_len]),
            Stuffing::Slip => Cow::Owned(unslip(&inner[..inner_len])?),
            Stuffing::Hdlc => Cow::Owned(unhdlc(&inner[..inner_len])?),
            Stuffing::Cobs => Cow::Owned(uncobs(&inner[..inner_len])?),
            // The bytes behind the end marker belong to the content.
            Stuffing::Dle => {
                let behind = &inner[inner_len + end.len()..];
                Cow::Owned([&*undle(&inner[..inner_len])?, behind].concat())
            }
        };
        match self.is_hex {
            true => {
                let odd = || FrameError::Implausible { at: 0, found };
                hex_bytes(&content).map(Cow::Owned).ok_or_else(odd)
            }
            false => Ok(content),
        }
    }

    /// The bytes on the wire for `content`.
    pub(super) fn wire(&self, content: Vec<u8>) -> Vec<u8> {
        let Cut::Marked {
            start,
            end,
            stuffing,
            tail,
        } = &self.cut
        else {
            return content;
        };
        let content = if self.is_hex {
            hex_text(&content)
        } else {
            content
        };
        let (inner, behind) = content.split_at(content.len().saturating_sub(*tail));
        let stuffed = match stuffing {
            Stuffing::None => inner.to_vec(),
            Stuffing::Slip => slip(inner),
            Stuffing::Hdlc => hdlc(inner),
            Stuffing::Cobs => cobs(inner),
            Stuffing::Dle => dle(inner),
        };
        [start, &*stuffed, end, behind].concat()
    }
}

/// Decodes pairs of hexadecimal digits.
pub(crate) fn hex_bytes(digits: &[u8]) -> Option<Vec<u8>> {
    let digit = |byte: u8| {
        char::from(byte)
            .to_digit(16)
            .and_then(|digit| u8::try_from(digit).ok())
    };
    let pairs = digits.chunks(2).map(|pair| match pair {
        [high, low] => Some(digit(*high)? << 4 | digit(*low)?),
        _ => None,
    });
    pairs.collect()
}

/// Bytes as upper-case hexadecimal digits.
pub(crate) fn hex_text(bytes: &[u8]) -> Vec<u8> {
    let pairs = bytes.iter().map(|byte| format!("{byte:02X}"));
    pairs.collect::<String>().into_bytes()
}

fn slip(content: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(content.len() + 2);
    for &byte in content {
        match byte {
            SLIP_END => out.extend([SLIP_ESC, SLIP_ESC_END]),
            SLIP_ESC => out.extend([SLIP_ESC, SLIP_ESC_ESC]),
            byte => out.push(byte),
        }
    }
    out
}

fn unslip(inner: &[u8]) -> Result<Vec<u8>, FrameError> {
    let mut out = Vec::with_capacity(inner.len());
    let mut bytes = inner.iter().copied();
    while let Some(byte) = bytes.next() {
        out.push(match byte {
            SLIP_ESC => match bytes.next() {
                Some(SLIP_ESC_END) => SLIP_END,
                Some(SLIP_ESC_ESC) => SLIP_ESC,
                other => {
                    return Err(FrameError::Escape {
                        found: other.unwrap_or(SLIP_END),
                    });
                }
            },
            byte => byte,
        });
    }
    Ok(out)
}

fn hdlc(content: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(content.len() + 2);
    for &byte in content {
        match byte {
            HDLC_FLAG | HDLC_ESC => out.extend([HDLC_ESC, byte ^ 0x20]),
            byte => out.push(byte),
        }
    }
    out
}

fn unhdlc(inner: &[u8]) -> Result<Vec<u8>, FrameError> {
    let mut out = Vec::with_capacity(inner.len());
    let mut bytes = inner.iter().copied();
    while let Some(byte) = bytes.next() {
        out.push(match byte {
            // Control characters may be escaped too.
            HDLC_ESC => match bytes.next() {
                Some(escaped) if escaped != HDLC_ESC => escaped ^ 0x20,
                other => {
                    return Err(FrameError::Escape {
                        found: other.unwrap_or(HDLC_FLAG),
                    });
                }
            },
            byte => byte,
        });
    }
    Ok(out)
}

fn cobs(content: &[u8]) -> Vec<u8> {
    let mut out = vec![1];
    let mut code = 0;
    for &byte in content {
        // A full group is closed only if bytes follow.
        if out[code] == 0xFF {
            code = out.len();
            out.push(1);
        }
        if byte == 0 {
            code = out.len();
            out.push(1);
        } else {
            out.push(byte);
            out[code] += 1;
        }
    }
    out
}

fn uncobs(inner: &[u8]) -> Result<Vec<u8>, FrameError> {
    let mut out = Vec::with_capacity(inner.len());
    let mut rest = inner;
    while let Some((&code, behind)) = rest.split_first() {
        let len = usize::from(code).wrapping_sub(1);
        let group = behind
            .get(..len)
            .ok_or(FrameError::Escape { found: code })?;
        out.extend_from_slice(group);
        rest = &behind[len..];
        if code < 0xFF && !rest.is_empty() {
            out.push(0);
        }
    }
    Ok(out)
}

fn dle(content: &[u8]) -> Vec<u8> {
    let twice = |byte: &u8| core::iter::repeat_n(*byte, if *byte == DLE { 2 } else { 1 });
    content.iter().flat_map(twice).collect()
}

fn undle(inner: &[u8]) -> Result<Vec<u8>, FrameError> {
    let mut out = Vec::with_capacity(inner.len());
    let mut bytes = inner.iter().copied();
    while let Some(byte) = bytes.next() {
        if byte == DLE {
            let found = bytes.next().unwrap_or(ETX);
            if found != DLE {
                return Err(FrameError::Escape { found });
            }
        }
        out.push(byte);
    }
    Ok(out)
}

/// The offset of the first DLE that begins the end marker: a DLE of the content is sent twice.
fn dle_end(bytes: &[u8], end: &[u8]) -> Result<Option<usize>, FrameError> {
    let mut at = 0;
    while let Some(next) = bytes.get(at + 1) {
        at += match (bytes[at], *next) {
            (DLE, DLE) => 2,
            (DLE, _) if bytes[at..].starts_with(end) => return Ok(Some(at)),
            (DLE, _) if end.starts_with(&bytes[at..]) => return Ok(None),
            (DLE, found) => return Err(FrameError::Escape { found }),
            _ => 1,
        };
    }
    Ok(None)
}

/// The offset of `wanted` in `bytes`.
fn find(bytes: &[u8], wanted: &[u8]) -> Option<usize> {
    match wanted {
        [] => None,
        [one] => bytes.iter().position(|byte| byte == one),
        more => bytes.windows(more.len()).position(|part| part == more),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Examples: the Wikipedia article on COBS, the SLIP bytes of RFC 1055, the octet stuffing of
    /// RFC 1662; DLE by hand, as the manuals of receivers with TSIP describe it.
    #[test]
    fn stuffing_gives_its_published_examples() {
        let examples: [(&[u8], &[u8]); 5] = [
            (&[0], &[1, 1]),
            (&[0, 0x11, 0], &[1, 2, 0x11, 1]),
            (&[0x11, 0x22, 0, 0x33], &[3, 0x11, 0x22, 2, 0x33]),
            (&[0x11, 0, 0, 0], &[2, 0x11, 1, 1, 1]),
            (&[], &[1]),
        ];
        for (plain, stuffed) in examples {
            assert_eq!(cobs(plain), stuffed);
            assert_eq!(uncobs(stuffed).as_deref(), Ok(plain));
        }
        let long: Vec<u8> = (1..=255).collect();
        let stuffed = cobs(&long[..254]);
        assert_eq!((stuffed[0], stuffed.len()), (0xFF, 255));
        assert_eq!(cobs(&long)[255..], [2, 0xFF]);
        assert_eq!(uncobs(&cobs(&long)), Ok(long));
        assert_eq!(slip(&[0xC0, 1, 0xDB]), [0xDB, 0xDC, 1, 0xDB, 0xDD]);
        assert_eq!(hdlc(&[0x7E, 0x7D]), [0x7D, 0x5E, 0x7D, 0x5D]);
        assert_eq!(dle(&[DLE, ETX]), [DLE, DLE, ETX]);
        assert_eq!(undle(&[DLE, DLE, ETX]).as_deref(), Ok(&[DLE, ETX][..]));
        let end = [DLE, ETX];
        // The third DLE begins the end marker; another byte behind a DLE is damage.
        assert_eq!(dle_end(&[DLE, DLE, ETX, DLE, ETX, 7], &end), Ok(Some(3)));
        assert_eq!(dle_end(&[1, DLE], &end), Ok(None));
        let escape = Err(FrameError::Escape { found: STX });
        assert_eq!(dle_end(&[1, DLE, STX, DLE, ETX], &end), escape);
        assert_eq!(unslip(&[0xDB, 1]), Err(FrameError::Escape { found: 1 }));
        assert_eq!(uncobs(&[5, 1]), Err(FrameError::Escape { found: 5 }));
    }
}
