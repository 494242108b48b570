//! Modbus: requests to a table of registers (application protocol specification V1.1b3) and frames
//! (serial line specification V1.02).

mod named;

pub use named::Asked;

use crate::registers::{Refusal, Registers, Table};
use crate::schema::message::From;
use crate::value::Value;

/// Exception codes.
const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;

/// Maximum numbers of registers and bits of a request (sections 6.1 to 6.17).
const READ_BITS_MAX: u16 = 2_000;
const READ_WORDS_MAX: u16 = 125;
const WRITE_BITS_MAX: u16 = 1_968;
const WRITE_WORDS_MAX: u16 = 123;
const EXCHANGE_WORDS_MAX: u16 = 121;
/// Length of the shortest request of function 23 with address and CRC.
const REQUEST_23_MIN: usize = 15;

/// The result of a request.
#[derive(Debug)]
pub(crate) struct Answer {
    /// The response without address and checksum.
    pub(crate) response: Vec<u8>,
    /// Variables that change, by index, with their new values.
    pub(crate) changes: Vec<(usize, Value)>,
    /// The error of the driver, if any.
    pub(crate) wrong: Option<Wrong>,
    /// Variables, by index, whose values do not fit the registers that are read.
    pub(crate) cut: Vec<usize>,
}

/// An error of the driver.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Wrong {
    Function(u8),
    Register(Refusal),
    /// Lengths and counts that contradict each other or the specification.
    Malformed(String),
}

type Values<'a> = &'a dyn Fn(usize) -> Value;

fn word(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]))
}

/// The answer of `registers` to a request without address and checksum.
pub(crate) fn answer(registers: &Registers, request: &[u8], values: Values<'_>) -> Answer {
    let function = request.first().copied().unwrap_or(0);
    let mut cut = Vec::new();
    match respond(registers, request, values, &mut cut) {
        Ok((body, changes)) => Answer {
            response: [&[function][..], &body].concat(),
            changes,
            wrong: None,
            cut,
        },
        Err(wrong) => {
            let code = match &wrong {
                Wrong::Function(_) => ILLEGAL_FUNCTION,
                Wrong::Register(Refusal::OutOfRange(..)) | Wrong::Malformed(_) => ILLEGAL_VALUE,
                Wrong::Register(_) => ILLEGAL_ADDRESS,
            };
            Answer {
                response: vec![function | 0x80, code],
                changes: Vec::new(),
                wrong: Some(wrong),
                cut: Vec::new(),
            }
        }
    }
}

type Response = (Vec<u8>, Vec<(usize, Value)>);

fn respond(
    registers: &Registers,
    request: &[u8],
    values: Values<'_>,
    cut: &mut Vec<usize>,
) -> Result<Response, Wrong> {
    let function = request.first().copied().unwrap_or(0);
    let is_known = registers.functions.is_empty() || registers.functions.contains(&function);
    let table = match function {
        1 | 5 | 15 => &registers.coils,
        2 => &registers.discrete,
        3 | 6 | 16 | 22 | 23 => &registers.holding,
        4 => &registers.input,
        _ => return Err(Wrong::Function(function)),
    };
    if !is_known || table.is_empty() {
        return Err(Wrong::Function(function));
    }
    let field = |at: usize| {
        let cut_off =
            || Wrong::Malformed(format!("function {function} with {} bytes", request.len()));
        word(request, at).ok_or_else(cut_off)
    };
    let exact = |len: usize| match request.len() == len {
        true => Ok(()),
        false => {
            let found = request.len();
            let detail = format!("function {function} with {found} bytes, expected {len}");
            Err(Wrong::Malformed(detail))
        }
    };
    let counted = |count: u16, most: u16| match (1..=most).contains(&count) {
        true => Ok(count),
        false => Err(Wrong::Malformed(format!(
            "function {function} for {count} registers, expected 1 to {most}"
        ))),
    };
    let at = field(1)?;
    match function {
        1 | 2 => {
            exact(5)?;
            let count = counted(field(3)?, READ_BITS_MAX)?;
            let bits = read(table, at, count, values, cut)?;
            Ok((prefixed(&pack(&bits)), Vec::new()))
        }
        3 | 4 => {
            exact(5)?;
            let count = counted(field(3)?, READ_WORDS_MAX)?;
            Ok((prefixed(&read(table, at, count, values, cut)?), Vec::new()))
        }
        5 => {
            exact(5)?;
            let value = match field(3)? {
                0xFF00 => 1,
                0 => 0,
                other => {
                    let detail = format!("coil set to {other:#06x}, expected 0xff00 or 0x0000");
                    return Err(Wrong::Malformed(detail));
                }
            };
            let changes = write(table, at, &[value], values)?;
            Ok((request[1..5].to_vec(), changes))
        }
        6 => {
            exact(5)?;
            let changes = write(table, at, &request[3..5], values)?;
            Ok((request[1..5].to_vec(), changes))
        }
        15 => {
            let count = counted(field(3)?, WRITE_BITS_MAX)?;
            let len = usize::from(count).div_ceil(8);
            exact(6 + len)?;
            byte_count(request[5], len)?;
            let bits = (0..usize::from(count)).map(|bit| request[6 + bit / 8] >> (bit % 8) & 1);
            let changes = write(table, at, &bits.collect::<Vec<_>>(), values)?;
            Ok((request[1..5].to_vec(), changes))
        }
        16 => {
            let count = counted(field(3)?, WRITE_WORDS_MAX)?;
            exact(6 + 2 * usize::from(count))?;
            byte_count(request[5], 2 * usize::from(count))?;
            let changes = write(table, at, &request[6..], values)?;
            Ok((request[1..5].to_vec(), changes))
        }
        22 => {
            exact(7)?;
            let (and, or) = (field(3)?, field(5)?);
            let old = read(table, at, 1, values, cut)?;
            let old = word(&old, 0).unwrap_or(0);
            let new = (old & and) | (or & !and);
            let changes = write(table, at, &new.to_be_bytes(), values)?;
            Ok((request[1..7].to_vec(), changes))
        }
        _ => {
            let count = counted(field(3)?, READ_WORDS_MAX)?;
            let (to, written) = (field(5)?, counted(field(7)?, EXCHANGE_WORDS_MAX)?);
            exact(10 + 2 * usize::from(written))?;
            byte_count(request[9], 2 * usize::from(written))?;
            // The write precedes the read (section 6.17).
            let changes = write(table, to, &request[10..], values)?;
            let changed = |variable: usize| {
                let new = changes
                    .iter()
                    .rev()
                    .find(|(changed, _)| *changed == variable);
                new.map_or_else(|| values(variable), |(_, value)| value.clone())
            };
            let bytes = read(table, at, count, &changed, cut)?;
            Ok((prefixed(&bytes), changes))
        }
    }
}

fn byte_count(found: u8, expected: usize) -> Result<(), Wrong> {
    match usize::from(found) == expected {
        true => Ok(()),
        false => Err(Wrong::Malformed(format!(
            "byte count is {found}, expected {expected}"
        ))),
    }
}

fn prefixed(bytes: &[u8]) -> Vec<u8> {
    let len = u8::try_from(bytes.len()).unwrap_or(u8::MAX);
    [&[len][..], bytes].concat()
}

fn read(
    table: &Table,
    at: u16,
    count: u16,
    values: Values<'_>,
    cut: &mut Vec<usize>,
) -> Result<Vec<u8>, Wrong> {
    table
        .read(at.into(), count.into(), values, cut)
        .map_err(Wrong::Register)
}

fn write(
    table: &Table,
    at: u16,
    bytes: &[u8],
    values: Values<'_>,
) -> Result<Vec<(usize, Value)>, Wrong> {
    table
        .write(at.into(), bytes, values)
        .map_err(Wrong::Register)
}

/// Packs bits into bytes, first bit lowest.
fn pack(bits: &[u8]) -> Vec<u8> {
    let bytes = bits.chunks(8).map(|bits| {
        let bits = bits.iter().enumerate();
        bits.fold(0, |byte, (place, bit)| byte | (bit & 1) << place)
    });
    bytes.collect()
}

/// Possible lengths of a frame of `from` with address and CRC, the most probable one first. A
/// device sends responses and a host sends requests; the other length is tried last, because a line
/// may echo and a capture may have mixed up its ends. Empty if more bytes are needed, `None` for
/// unknown functions.
pub(crate) fn lengths(bytes: &[u8], from: From) -> Option<Vec<usize>> {
    let Some(&function) = bytes.get(1) else {
        return Some(Vec::new());
    };
    let count = |at: usize| bytes.get(at).copied().map(usize::from);
    let [request, response] = match function {
        1..=4 => [Some(8), count(2).map(|count| 5 + count)],
        5 | 6 => [Some(8); 2],
        15 | 16 => [count(6).map(|count| 9 + count), Some(8)],
        22 => [Some(10); 2],
        // Without its count, the shortest request.
        23 => [
            Some(count(10).map_or(REQUEST_23_MIN, |count| 13 + count)),
            count(2).map(|count| 5 + count),
        ],
        0x81..=0x97 => [Some(5); 2],
        _ => return None,
    };
    let (Some(request), Some(response)) = (request, response) else {
        return Some(Vec::new());
    };
    let mut all = match from {
        From::Host => vec![request, response],
        From::Device => vec![response, request],
        From::Both => vec![request.max(response), request.min(response)],
    };
    all.dedup();
    Some(all)
}

const FUNCTIONS: [(u8, &str); 10] = [
    (1, "read coils"),
    (2, "read discrete inputs"),
    (3, "read holding registers"),
    (4, "read input registers"),
    (5, "write coil"),
    (6, "write register"),
    (15, "write coils"),
    (16, "write registers"),
    (22, "mask register"),
    (23, "exchange registers"),
];

/// The name of a function code.
pub(crate) fn function_name(function: u8) -> &'static str {
    let known = FUNCTIONS.iter().find(|(code, _)| *code == function & 0x7F);
    known.map_or("unknown function", |(_, name)| name)
}

/// The address to which any device of some makers answers, e.g. each CO2 sensor of Senseair.
const ANY_DEVICE: u32 = 254;

/// Checks that a device can have this address. Source: Modbus over serial line V1.02, section 2.2.
///
/// # Errors
/// If it cannot; with the reason and the allowed addresses.
pub(crate) fn check_address(address: u32) -> Result<(), String> {
    let reason = match address {
        1..=247 | ANY_DEVICE => return Ok(()),
        0 => "0 is a broadcast, which no device answers",
        248..=255 => "Modbus reserves 248 to 255",
        _ => "an address is one byte",
    };
    Err(format!(
        "is {address}, expected 1 to 247 (or 254, to which any device of some makers answers): {reason}"
    ))
}

/// Whether a body with this function and these further bytes is that of a response to a read.
///
/// A request to read from 0x0300 on has the same form as a response with 3 bytes.
fn is_read_response(function: u8, rest: &[u8], from: From) -> bool {
    let Some((count, bytes)) = rest.split_first() else {
        return false;
    };
    let is_request = bytes.len() == 3 && (function > 2 || from == From::Host);
    usize::from(*count) == bytes.len() && !is_request
}

/// The body of a frame of `from`, with its address, in words.
pub(crate) fn words(body: &[u8], from: From) -> String {
    let [address, function, rest @ ..] = body else {
        return "too short for Modbus".to_owned();
    };
    let name = function_name(*function);
    let values = |bytes: &[u8]| {
        let words = bytes.chunks(2).map(|pair| match pair {
            [high, low] => u16::from_be_bytes([*high, *low]).to_string(),
            one => format!("{one:02X?}"),
        });
        words.collect::<Vec<_>>().join(" ")
    };
    let said = match (function, rest) {
        (0x80.., [code, ..]) => {
            let what = match *code {
                ILLEGAL_FUNCTION => "illegal function",
                ILLEGAL_ADDRESS => "illegal data address",
                ILLEGAL_VALUE => "illegal data value",
                4 => "device failure",
                5 => "acknowledge",
                6 => "busy",
                _ => "unknown",
            };
            format!("refused {name}: {what} ({code})")
        }
        (1..=4, [_, bytes @ ..]) if is_read_response(*function, rest, from) => match function {
            1 | 2 => format!("{name}: {bytes:02X?}"),
            _ => format!("{name}: {}", values(bytes)),
        },
        (1..=4, [a, b, c, d]) => {
            let (at, count) = (u16::from_be_bytes([*a, *b]), u16::from_be_bytes([*c, *d]));
            format!("{name} {at}, {count} of them")
        }
        (5 | 6, [a, b, c, d]) => {
            let (at, value) = (u16::from_be_bytes([*a, *b]), u16::from_be_bytes([*c, *d]));
            format!("{name} {at} = {value}")
        }
        (15 | 16, [a, b, c, d, rest @ ..]) => {
            let (at, count) = (u16::from_be_bytes([*a, *b]), u16::from_be_bytes([*c, *d]));
            match rest {
                [] => format!("{name} {at}, {count} of them: done"),
                [_, bytes @ ..] if *function == 16 => format!("{name} {at} = {}", values(bytes)),
                [_, bytes @ ..] => format!("{name} {at}, {count} of them = {bytes:02X?}"),
            }
        }
        (_, rest) => format!("{name}: {rest:02X?}"),
    };
    format!("device {address}: {said}")
}
