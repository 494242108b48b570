//! `[frame]`: the ends of frames, and the bytes that are not body.

use core::time::Duration;

use protocols::LineConfig;

use super::{Compiler, whole};
use crate::checksum::Algorithm;
use crate::description::Protocol;
use crate::expr::Expr;
use crate::framing::{Check, Cut, DLE, FRAME_MAX, Framing, HeadSize, Length};
use crate::modbus;
use crate::number::{Number, NumberKind, Orders};
use crate::schema::wire::{Counts, Encoding, Endian, FrameSpec, LengthSpec, SizeSpec, Stuffing};

/// Maximum number of bytes of a frame if the file sets no limit.
const MAX: u16 = 1_024;
/// Maximum number of bytes of a Modbus frame on a serial line.
const MODBUS_MAX: usize = 256;
/// The silence that ends a Modbus frame above 19200 baud (serial line specification, 2.5.1.1).
const FAST_SILENCE: Duration = Duration::from_micros(1_750);

/// The duration of `characters` characters.
fn silence(line: LineConfig, characters: f64) -> Duration {
    let nanos = Duration::from_secs_f64(
        characters.clamp(0.0, 10_000.0) * f64::from(line.bits_per_byte()) / f64::from(line.baud),
    );
    nanos.max(Duration::from_nanos(1))
}

impl Compiler<'_> {
    /// Compiles the frame formats.
    pub(super) fn frames(&mut self, line: LineConfig, protocol: Option<Protocol>) -> Vec<Framing> {
        let specs = &self.schema.frame.0;
        match protocol {
            Some(protocol) => {
                if !specs.is_empty() {
                    self.wrong(
                        "frame",
                        "the protocol defines its own frames, leave them out",
                    );
                }
                vec![of_protocol(protocol, line)]
            }
            None => {
                if specs.is_empty() {
                    let message = "there are no frames, expected [frame] or a protocol";
                    self.wrong("name", message);
                }
                let is_single = specs.len() == 1;
                let frames = specs.iter().enumerate().map(|(index, spec)| {
                    let key = if is_single {
                        "frame".to_owned()
                    } else {
                        format!("frame[{index}]")
                    };
                    self.frame(&key, spec, line)
                });
                let frames: Vec<Framing> = frames.collect();
                self.check_frame_names(&frames);
                frames
            }
        }
    }

    fn check_frame_names(&mut self, frames: &[Framing]) {
        for (index, frame) in frames.iter().enumerate() {
            if frames[..index].iter().any(|other| other.name == frame.name) {
                let key = format!("frame[{index}].name");
                let message = format!("\"{}\" is taken, expected a name for each", frame.name);
                self.wrong(key, message);
            }
        }
    }

    fn frame(&mut self, key: &str, spec: &FrameSpec, line: LineConfig) -> Framing {
        let cut = self.cut(key, spec);
        let is_marked = matches!(cut, Cut::Marked { .. });
        let sync = spec.sync.clone().unwrap_or_default().0;
        if is_marked && !sync.is_empty() {
            self.wrong(
                format!("{key}.sync"),
                "the end is marked, expected \"start\" instead",
            );
        }
        self.check_keys(key, spec, is_marked);
        let end = match (&cut, &spec.end) {
            (Cut::Marked { .. }, _) => self.closing(key, spec),
            (_, None) => Vec::new(),
            (_, Some(end)) => end.0.clone(),
        };
        let (checks, holes, trailer) = self.checks(key, spec, &cut, &sync, end.len());
        let most = spec.max.unwrap_or(MAX);
        if most == 0 || usize::from(most) > FRAME_MAX {
            self.wrong(
                format!("{key}.max"),
                format!("is {most}, expected 1 to {FRAME_MAX}"),
            );
        }
        let quiet = match spec.silence {
            Some(characters) => silence(line, characters),
            None => silence(line, 20.0).max(Duration::from_millis(10)),
        };
        let mut framing = Framing {
            name: spec.name.clone(),
            sync,
            is_hex: spec.encoding == Some(Encoding::Hex),
            holes,
            trailer,
            end,
            has_blank: self.has_blank(&spec.name),
            max: usize::from(most).min(FRAME_MAX),
            idle: spec.idle.map_or(quiet, |span| span.0),
            ..Framing::new(cut, checks)
        };
        if framing.is_hex && !is_marked {
            let message = "hex digits need markers, expected \"start\" and \"end\"";
            self.wrong(format!("{key}.encoding"), message);
        }
        self.finish_length(key, spec, &mut framing);
        framing
    }

    /// Records errors for keys of another kind of frame.
    fn check_keys(&mut self, key: &str, spec: &FrameSpec, is_marked: bool) {
        let is_computed = matches!(spec.size, Some(SizeSpec::Expression(_)));
        let marked = "only a frame with an end marker has it";
        let computed = "only an expression in \"size\" reads these bytes";
        let sizes = "only \"sizes\" reads this byte";
        for (name, is_given, is_used, why) in [
            ("start", spec.start.is_some(), is_marked, marked),
            ("tail", spec.tail.is_some(), is_marked, marked),
            ("closing", spec.closing.is_some(), is_marked, marked),
            ("head", spec.head.is_some(), is_computed, computed),
            ("at", spec.at.is_some(), !spec.sizes.is_empty(), sizes),
        ] {
            if is_given && !is_used {
                let hint = match name {
                    "start" => "; expected \"sync\" for the first bytes",
                    "tail" | "closing" => {
                        "; expected \"end\" for the last byte, or constant fields"
                    }
                    _ => "; leave it out",
                };
                self.wrong(
                    format!("{key}.{name}"),
                    format!("has no effect: {why}{hint}"),
                );
            }
        }
    }

    /// The last bytes of the tail of a marked frame.
    fn closing(&mut self, key: &str, spec: &FrameSpec) -> Vec<u8> {
        let closing = spec.closing.clone().unwrap_or_default().0;
        let tail = usize::from(spec.tail.unwrap_or(0));
        if closing.len() > tail {
            let message = format!(
                "has {} bytes, expected at most those of \"tail\", {tail}",
                closing.len()
            );
            self.wrong(format!("{key}.closing"), message);
            return Vec::new();
        }
        closing
    }

    /// Whether an empty line, or a line of line ends only, is a message of this format.
    fn has_blank(&self, name: &str) -> bool {
        let first = self.schema.frame.0.first();
        let is_first = first.is_some_and(|first| first.name == name);
        let own = self
            .schema
            .message
            .iter()
            .filter(|message| match &message.frame {
                Some(frame) => frame == name,
                None => is_first,
            });
        let mut texts = own.filter_map(|message| message.text.as_ref());
        texts.any(|text| text.is_empty() || text.starts_with(['\r', '\n']))
    }

    /// Computes the base of the length field, which depends on the bytes behind the body.
    fn finish_length(&mut self, key: &str, spec: &FrameSpec, framing: &mut Framing) {
        let (Cut::Length(length), Some(field)) = (&mut framing.cut, &spec.length) else {
            return;
        };
        let behind = length.at + usize::from(length.number.bytes);
        let uncounted = match field.counts {
            Counts::Payload => behind + framing.trailer,
            Counts::Rest => behind,
            Counts::Frame => 0,
        };
        length.base = i64::try_from(uncounted).unwrap_or(0) + i64::from(field.without);
        if length.mask.count_ones() == 8 * u32::from(length.number.bytes) {
            let hole = (length.at, length.number.bytes.into());
            let overlaps = framing
                .holes
                .iter()
                .any(|(at, len)| *at < hole.0 + hole.1 && hole.0 < at + len);
            if overlaps {
                let message = "overlaps the sync bytes or a checksum, expected its own bytes";
                self.wrong(format!("{key}.length.at"), message);
            }
            framing.holes.push(hole);
            framing.holes.sort_unstable();
        }
        if let Some(at) = length.again {
            let len = usize::from(length.number.bytes);
            let overlaps = framing
                .holes
                .iter()
                .any(|(other, other_len)| *other < at + len && at < other + other_len);
            if overlaps {
                let message = "overlaps other fields of the frame, expected its own bytes";
                self.wrong(format!("{key}.length.again"), message);
            } else {
                framing.holes.push((at, len));
                framing.holes.sort_unstable();
            }
        }
    }

    fn cut(&mut self, key: &str, spec: &FrameSpec) -> Cut {
        let stuffing = spec.stuffing.unwrap_or(Stuffing::None);
        let given = [
            ("terminator", spec.terminator.is_some()),
            ("length", spec.length.is_some()),
            ("size", spec.size.is_some()),
            ("sizes", !spec.sizes.is_empty()),
            ("silence", spec.silence.is_some()),
            ("stuffing", stuffing != Stuffing::None),
        ];
        let given: Vec<_> = given
            .iter()
            .filter(|(_, is)| *is)
            .map(|(name, _)| *name)
            .collect();
        if given.len() > 1 {
            let message = format!("has {}, expected one of them", given.join(" and "));
            self.wrong(key, message);
        }
        let start = spec.start.clone().unwrap_or_default().0;
        let tail = usize::from(spec.tail.unwrap_or(0));
        let marked = |start, end| Cut::Marked {
            start,
            end,
            stuffing,
            tail,
        };
        if let Some(terminator) = &spec.terminator {
            if terminator.0.is_empty() {
                self.wrong(
                    format!("{key}.terminator"),
                    "is empty, expected the bytes that end a line",
                );
            }
            return marked(start, terminator.0.clone());
        }
        if let Some(markers) = stuffing.markers() {
            return self.stuffed(key, spec, (stuffing, tail), markers);
        }
        if let Some(length) = &spec.length {
            return Cut::Length(self.length(&format!("{key}.length"), length));
        }
        if let Some(size) = &spec.size {
            return self.sized(key, spec, size);
        }
        if !spec.sizes.is_empty() {
            return self.sizes(key, spec);
        }
        if let Some(characters) = spec.silence {
            if !(0.5..=1_000.0).contains(&characters) {
                let message = format!("is {characters}, expected 0.5 to 1000 characters");
                self.wrong(format!("{key}.silence"), message);
            }
            return Cut::Silence { lengths: None };
        }
        if let Some(end) = &spec.end {
            if end.0.is_empty() {
                self.wrong(
                    format!("{key}.end"),
                    "is empty, expected the bytes that end a frame",
                );
            }
            return marked(start, end.0.clone());
        }
        let message = "nothing says where a frame ends, expected one of \"terminator\", \"end\", \
            \"length\", \"size\", \"sizes\", \"silence\"";
        self.wrong(key, message);
        Cut::Fixed(1)
    }

    /// Frames with markers that the stuffing keeps out of their bytes.
    fn stuffed(
        &mut self,
        key: &str,
        spec: &FrameSpec,
        (stuffing, tail): (Stuffing, usize),
        [plain_start, plain_end]: [&[u8]; 2],
    ) -> Cut {
        let of = |given: &Option<crate::schema::short::Marker>, plain: &[u8]| {
            given
                .as_ref()
                .map_or_else(|| plain.to_vec(), |given| given.0.clone())
        };
        let [start, end] = [of(&spec.start, plain_start), of(&spec.end, plain_end)];
        let is_dle = stuffing == Stuffing::Dle;
        let is_end = match end[..] {
            [first, second] if is_dle => first == DLE && second != DLE,
            _ => end == plain_end,
        };
        if !is_end {
            let expected = match is_dle {
                true => "0x10 and another byte".to_owned(),
                false => format!("[0x{:02X}]", plain_end[0]),
            };
            let message = format!("is {end:02X?}, expected {expected} with this stuffing");
            self.wrong(format!("{key}.end"), message);
        }
        let is_start = match start[..] {
            [] => !is_dle,
            [DLE] if is_dle => true,
            [DLE, second] if is_dle => second != DLE && start != end,
            _ => start == plain_end,
        };
        if !is_start {
            let expected = match is_dle {
                true => "0x10, alone or with a byte that is not the end marker's".to_owned(),
                false => format!("[0x{:02X}] or none", plain_end[0]),
            };
            let message = format!("is {start:02X?}, expected {expected}");
            self.wrong(format!("{key}.start"), message);
        }
        Cut::Marked {
            start,
            end,
            stuffing,
            tail,
        }
    }

    fn length(&mut self, key: &str, spec: &LengthSpec) -> Length {
        let orders = Orders {
            endian: self.schema.endian,
            words: None,
        };
        let number = match Number::named(&spec.kind, orders) {
            Some(Ok(number)) if number.kind == NumberKind::Unsigned && number.bytes <= 4 => number,
            Some(Err(message)) => {
                self.wrong(format!("{key}.type"), message);
                Number {
                    bytes: 1,
                    kind: NumberKind::Unsigned,
                    endian: Endian::Big,
                    words: Endian::Big,
                }
            }
            _ => {
                let message = format!("is \"{}\", expected u8, u16le, u16be, ..", spec.kind);
                self.wrong(format!("{key}.type"), message);
                Number {
                    bytes: 1,
                    kind: NumberKind::Unsigned,
                    endian: Endian::Big,
                    words: Endian::Big,
                }
            }
        };
        let all = u64::MAX >> (64 - 8 * u32::from(number.bytes));
        let mask = spec.mask.map_or(all, u64::from);
        if mask == 0 || mask & !all != 0 {
            let message = format!("is {mask:#x}, expected bits of the field");
            self.wrong(format!("{key}.mask"), message);
        }
        let unit = i64::from(spec.unit.unwrap_or(1));
        if unit == 0 {
            self.wrong(
                format!("{key}.unit"),
                "is 0, expected bytes for each that it counts",
            );
        }
        let mask = if mask == 0 { all } else { mask };
        Length {
            at: spec.at.into(),
            number,
            unit: unit.max(1),
            base: 0,
            mask,
            again: spec.again.map(usize::from),
        }
    }

    fn sized(&mut self, key: &str, spec: &FrameSpec, size: &SizeSpec) -> Cut {
        match size {
            SizeSpec::Bytes(bytes) => {
                let size = usize::try_from(*bytes).unwrap_or(usize::MAX);
                if !(1..=FRAME_MAX).contains(&size) {
                    let message = format!("is {size}, expected 1 to {FRAME_MAX} bytes");
                    self.wrong(format!("{key}.size"), message);
                }
                Cut::Fixed(size.clamp(1, FRAME_MAX))
            }
            SizeSpec::Expression(text) => {
                let head = spec.head.unwrap_or(1);
                if head == 0 {
                    self.wrong(format!("{key}.head"), "is 0, expected at least 1 byte");
                }
                let known = |name: &str| {
                    let at = name.strip_prefix('b').and_then(|at| at.parse::<u8>().ok());
                    at.is_some_and(|at| at < head)
                };
                let names = || format!("b0 to b{}", head.saturating_sub(1));
                let size: Expr = self.expr(&format!("{key}.size"), text, &known, &names);
                let head = usize::from(head.max(1));
                let size = HeadSize::new(size, head);
                Cut::Sized { head, size }
            }
        }
    }

    fn sizes(&mut self, key: &str, spec: &FrameSpec) -> Cut {
        let mut sizes = Box::new([0; 256]);
        let at = usize::from(spec.at.unwrap_or(0));
        for (byte, &size) in &spec.sizes {
            let key = format!("{key}.sizes.{byte}");
            let Some(byte) = whole(byte).and_then(|byte| u8::try_from(byte).ok()) else {
                self.wrong(
                    key,
                    format!("\"{byte}\" is no byte, expected 0 to 255 or 0x00 to 0xFF"),
                );
                continue;
            };
            if usize::from(size) <= at || usize::from(size) > FRAME_MAX {
                let message = format!("is {size}, expected {} to {FRAME_MAX} bytes", at + 1);
                self.wrong(key, message);
            }
            sizes[usize::from(byte)] = size;
        }
        Cut::Table { at, sizes }
    }
}

/// The frame format of a built-in protocol.
fn of_protocol(protocol: Protocol, line: LineConfig) -> Framing {
    let (name, width) = match protocol {
        Protocol::ModbusRtu => ("CRC-16/MODBUS", 2),
        Protocol::ModbusAscii => ("LRC", 1),
    };
    let (algorithm, _) = Algorithm::named(name).expect("a known name");
    let check = Check {
        algorithm,
        width,
        is_little: true,
        is_hex: false,
        separator: Vec::new(),
        extra: Vec::new(),
        before: Vec::new(),
        from: 0,
        to: None,
        at: -i64::from(width),
    };
    let quiet = match line.baud {
        ..=19_200 => silence(line, 3.5),
        _ => FAST_SILENCE,
    };
    let (cut, idle) = match protocol {
        Protocol::ModbusRtu => (
            Cut::Silence {
                lengths: Some(modbus::lengths),
            },
            quiet,
        ),
        Protocol::ModbusAscii => {
            let (start, end) = (b":".to_vec(), b"\r\n".to_vec());
            // Characters may come up to a second apart (serial line specification, 2.5.2.1).
            (
                Cut::Marked {
                    start,
                    end,
                    stuffing: Stuffing::None,
                    tail: 0,
                },
                Duration::from_secs(1),
            )
        }
    };
    Framing {
        is_hex: protocol == Protocol::ModbusAscii,
        trailer: usize::from(width),
        max: if protocol == Protocol::ModbusRtu {
            MODBUS_MAX
        } else {
            2 * MODBUS_MAX + 1
        },
        idle,
        ..Framing::new(cut, vec![check])
    }
}
