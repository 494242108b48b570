//! The board: a program, its ports, and the time of the rig.

use core::time::Duration;

use firmware_core::{Master, Work};
use protocols::{Instant, LineConfig, LineEvent, Parity, Port};
use semihosting::experimental::env;
use semihosting::{eprintln, process};

use crate::load::Load;
use crate::wire::Wire;

/// Most ports of a program.
const PORTS_MAX: usize = 8;
/// Longest command line.
const WORDS_MAX: usize = 4096;
/// Most bytes that leave at once.
const PIECE_MAX: usize = 4096;
/// The rig has a port that the firmware has not.
const NO_PORT: &str = "this firmware has no such port";
/// Later than any run.
const NEVER: u64 = u64::MAX;
/// Answer to the greeting.
const GREETING: &[u8] = br#"{"hilrig_node": 1}"#;
/// Clock of the robots' boards, an STM32F407.
const CLOCK_HZ: u64 = 168_000_000;

/// Settings from the command line.
pub struct Setup {
    lines: [Option<Line>; PORTS_MAX],
    /// Price of a scan, a try, a point, nanoseconds.
    cost: [u64; 3],
    clock_hz: u64,
}

/// The program's end of a link.
#[derive(Clone, Copy)]
struct Line {
    port: Port,
    /// Maximum number of bytes sent at once.
    piece: usize,
    /// Time at which the last byte will have been sent.
    free_at: u64,
    /// Whether the program may have more bytes: it is asked again at `free_at`.
    has_more: bool,
    /// The coding that the rig knows.
    coding: Option<LineConfig>,
}

impl Setup {
    /// Reads the command line. `ports` are the program's ports by their names. `set` takes a
    /// setting, or returns the expected value.
    pub fn read(
        ports: &[(&str, Port)],
        mut set: impl FnMut(&str, &str) -> Result<(), &'static str>,
    ) -> Self {
        let mut setup = Self {
            lines: [None; PORTS_MAX],
            cost: [0; 3],
            clock_hz: CLOCK_HZ,
        };
        let mut next = 0;
        let words = env::args::<WORDS_MAX>().unwrap_or_else(|_| refuse("command line", "too long"));
        // The first word is the program's name.
        for word in (&words).skip(1) {
            let word = word.unwrap_or_else(|_| refuse("command line", "expected UTF-8"));
            let Some((key, value)) = word.split_once('=') else {
                refuse(word, "expected KEY=VALUE");
            };
            let read = match key {
                "port" | "optional" => {
                    let line = line_of(ports, value).and_then(|line| match setup.has(line.port) {
                        true => Err("two ports of the rig are connected to this one"),
                        false => Ok(line),
                    });
                    let place = setup.lines.get_mut(next).ok_or("expected at most 8 ports");
                    next += 1;
                    match line {
                        Err(NO_PORT) if key == "optional" => Ok(()),
                        line => line.and_then(|line| place.map(|place| *place = Some(line))),
                    }
                }
                "cost" => numbers(value).map(|cost| setup.cost = cost),
                "clock" => numbers(value).map(|[hz]| setup.clock_hz = hz),
                _ => set(key, value),
            };
            if let Err(expected) = read {
                if expected == NO_PORT {
                    let names = ports.iter().map(|(name, _)| *name);
                    names.for_each(|name| eprintln!("this firmware has the port {name}"));
                }
                refuse(word, expected);
            }
        }
        setup
    }

    fn has(&self, port: Port) -> bool {
        self.lines.iter().flatten().any(|line| line.port == port)
    }

    /// Plays the node `program` until the rig ends it.
    pub fn run(self, program: impl Master) -> ! {
        let mut board = Board {
            wire: Wire::open(),
            load: Load::start(self.clock_hz),
            lines: self.lines,
            cost: self.cost,
            polled_at: 0,
            busy_until: 0,
            program,
        };
        loop {
            board.serve();
        }
    }
}

/// A program on its board.
pub struct Board<M> {
    wire: Wire,
    load: Load,
    lines: [Option<Line>; PORTS_MAX],
    cost: [u64; 3],
    /// Time of the program's next poll.
    polled_at: u64,
    /// Until then the processor computes.
    busy_until: u64,
    program: M,
}

impl<M: Master> Board<M> {
    /// Answers one request.
    fn serve(&mut self) {
        let request = self.wire.next();
        match request.kind {
            b'H' => {
                let is_known = self.wire.is_known_version(request);
                self.wire.answer(b'h', GREETING);
                if !is_known {
                    refuse(
                        "the rig's greeting",
                        "expected version 1 of the node protocol",
                    );
                }
            }
            b'X' => {
                self.load.begin();
                let (now, items) = self.wire.exchange(request);
                let mut is_touched = false;
                for item in items {
                    let line = self.lines.get(usize::from(item.port));
                    let Some(port) = line.copied().flatten().map(|line| line.port) else {
                        continue;
                    };
                    let at = Instant::from_nanos(item.at);
                    match (item.kind, item.payload) {
                        (1, bytes) => self.program.receive(port, at, bytes),
                        (2, &[code, ..]) => {
                            let Some(event) = event_of(code) else {
                                continue;
                            };
                            self.program.line_event(port, at, event);
                        }
                        _ => continue,
                    }
                    is_touched = true;
                }
                if is_touched || self.polled_at <= now {
                    self.poll(now);
                    is_touched = true;
                }
                self.wire.begin_reply();
                let next = self.send(now, is_touched);
                self.load.end(now);
                self.wire.reply(next);
            }
            b'E' => {
                self.load.report();
                process::exit(0)
            }
            kind => panic!("the rig sent a request of type {kind}"),
        }
    }

    /// Polls the program, unless the processor computes.
    fn poll(&mut self, now: u64) {
        self.polled_at = if self.busy_until > now {
            self.busy_until
        } else {
            self.program.poll(Instant::from_nanos(now));
            let work = self.program.take_work();
            match self.cost_of(work) {
                0 => {
                    let at = self.program.poll_at().map_or(NEVER, Instant::as_nanos);
                    at.max(now + 1)
                }
                cost => {
                    self.busy_until = now + cost;
                    self.busy_until
                }
            }
        };
    }

    fn cost_of(&self, work: Work) -> u64 {
        let amounts = [work.scans, work.tries, work.points];
        let costs = self.cost.iter().zip(amounts);
        costs.map(|(cost, amount)| cost * u64::from(amount)).sum()
    }

    /// Sends the bytes that are due at `now`; returns the time of the rig's next poll.
    fn send(&mut self, now: u64, is_touched: bool) -> u64 {
        let mut next = self.polled_at;
        let lines = (0..).zip(&mut self.lines);
        for (number, line) in lines.filter_map(|(number, line)| Some((number, line.as_mut()?))) {
            let (wire, program, port) = (&mut self.wire, &mut self.program, line.port);
            let coding = program.line_config(port);
            if line.coding != Some(coding) {
                line.coding = Some(coding);
                wire.item(2, number, now, 8, |room| write_coding(room, coding));
            }
            let is_due = line.has_more && line.free_at <= now;
            if (is_touched || is_due) && program.may_send(port) {
                if let Some(code) = program.line_change(port).and_then(code_of) {
                    wire.item(2, number, now, 1, |room| {
                        room[0] = code;
                        1
                    });
                }
                // Until the line is free, more bytes wait; it is asked then.
                line.has_more = true;
                if line.free_at <= now {
                    let sent = wire.item(1, number, now, line.piece, |room| {
                        program.transmit(port, room)
                    });
                    line.has_more = sent > 0 && program.may_send(port);
                    line.free_at = now + nanos(coding.bytes_time(sent as u64));
                }
            } else if is_due {
                line.has_more = false;
            }
            if line.has_more && line.free_at > now {
                next = next.min(line.free_at);
            }
        }
        next
    }
}

fn nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// Ends the firmware: `word` of the command line is wrong.
fn refuse(word: &str, expected: &str) -> ! {
    eprintln!("{word}: {expected}");
    process::exit(2)
}

fn line_of(ports: &[(&str, Port)], value: &str) -> Result<Line, &'static str> {
    let (name, piece) = value.rsplit_once(':').ok_or("expected NAME:PIECE")?;
    let port = ports.iter().find(|(known, _)| *known == name);
    let (_, port) = port.ok_or(NO_PORT)?;
    let piece = piece.parse().map_err(|_| "expected a number of bytes")?;
    Ok(Line {
        port: *port,
        piece: usize::clamp(piece, 1, PIECE_MAX),
        free_at: 0,
        has_more: false,
        coding: None,
    })
}

fn numbers<const N: usize>(value: &str) -> Result<[u64; N], &'static str> {
    let mut words = value.split(':');
    let mut numbers = [0; N];
    for number in &mut numbers {
        let word = words.next().ok_or("expected more numbers")?;
        *number = word.parse().map_err(|_| "expected whole numbers")?;
    }
    words
        .next()
        .map_or(Ok(numbers), |_| Err("expected fewer numbers"))
}

/// Codes of `docs/nodes.md`.
const EVENTS: [LineEvent; 6] = [
    LineEvent::Opened,
    LineEvent::Closed,
    LineEvent::Break,
    LineEvent::FramingError,
    LineEvent::ParityError,
    LineEvent::Overrun,
];

fn event_of(code: u8) -> Option<LineEvent> {
    EVENTS.get(usize::from(code)).copied()
}

fn code_of(event: LineEvent) -> Option<u8> {
    let place = EVENTS.iter().position(|known| *known == event)?;
    u8::try_from(place).ok()
}

/// 16, rate, data bits, parity, stop bits.
fn write_coding(room: &mut [u8], coding: LineConfig) -> usize {
    let parity = match coding.parity {
        Parity::None => 0,
        Parity::Even => 1,
        Parity::Odd => 2,
    };
    room[0] = 16;
    room[1..5].copy_from_slice(&coding.baud.to_le_bytes());
    room[5..8].copy_from_slice(&[coding.data_bits, parity, coding.stop_bits]);
    8
}
