//! The module against a model that fits one page: no FIFO, no frames, no log, only the connection
//! and the stored settings.

use proptest::prelude::*;
use protocols::hc06::{Command, baud_of};

use super::*;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Port {
    Closed,
    Waiting,
    Connected,
}

/// A reference model of a linvor module with default figures, by the rules of the guides.
struct Reference {
    powered: bool,
    data_mode: bool,
    in_reach: bool,
    port: Port,
    connect_at: Option<Instant>,
    give_up_at: Option<Instant>,
    name: Vec<u8>,
    pin: [u8; 4],
    baud: u32,
    text: Vec<u8>,
    first: Instant,
    last: Instant,
    replies: String,
}

impl Reference {
    fn new() -> Self {
        Self {
            powered: true,
            data_mode: false,
            in_reach: true,
            port: Port::Closed,
            connect_at: None,
            give_up_at: None,
            name: b"linvor".to_vec(),
            pin: *b"1234",
            baud: 9_600,
            text: Vec::new(),
            first: Instant::ZERO,
            last: Instant::ZERO,
            replies: String::new(),
        }
    }

    fn mode(&self) -> Mode {
        match (self.powered, self.data_mode) {
            (false, _) => Mode::Off,
            (true, true) => Mode::Data,
            (true, false) => Mode::Command,
        }
    }

    fn tick(&mut self, now: Instant) {
        loop {
            let silent_at = (!self.text.is_empty()).then(|| self.last + SECOND / 2);
            let Some(at) =
                earliest([silent_at, self.connect_at, self.give_up_at]).filter(|&at| at <= now)
            else {
                return;
            };
            if silent_at == Some(at) {
                self.command();
            }
            if self.connect_at == Some(at) {
                self.port = Port::Connected;
                self.data_mode = true;
                self.give_up_at = None;
                self.text.clear();
            }
            if self.give_up_at == Some(at) {
                self.give_up_at = None;
                if self.port == Port::Connected {
                    self.port = Port::Closed;
                }
                self.disconnect();
            }
            self.plan(at);
        }
    }

    fn command(&mut self) {
        let text = core::mem::take(&mut self.text);
        if self.last - self.first > SECOND {
            return;
        }
        match Command::parse(&text) {
            Some(Command::Attention) => self.replies += "OK",
            Some(Command::Version) => self.replies += "OKlinvorV1.8",
            Some(Command::Name(name)) => {
                self.name = name.to_vec();
                self.replies += "OKsetname";
            }
            Some(Command::Pin(pin)) => {
                self.pin = pin;
                self.replies += "OKsetPIN";
            }
            Some(Command::Baud(rate)) => {
                self.baud = rate;
                self.replies += &format!("OK{rate}");
            }
            _ => {}
        }
    }

    fn disconnect(&mut self) {
        if self.data_mode {
            self.data_mode = false;
            self.text.clear();
        }
    }

    /// A connection takes a second in which module, radio and port are there.
    fn plan(&mut self, now: Instant) {
        let possible =
            self.port == Port::Waiting && self.powered && !self.data_mode && self.in_reach;
        self.connect_at = possible.then(|| self.connect_at.unwrap_or(now + SECOND));
    }

    fn expect_give_up(&mut self, now: Instant) {
        if self.data_mode || self.port == Port::Connected {
            self.give_up_at = earliest([self.give_up_at, Some(now + 20 * SECOND)]);
        }
    }

    fn byte(&mut self, byte: u8, at: Instant) {
        self.tick(at);
        if self.mode() == Mode::Command {
            if self.text.is_empty() {
                self.first = at;
            }
            self.text.push(byte);
            self.last = at;
        }
    }

    fn does(&mut self, op: &Op, now: Instant) {
        self.tick(now);
        match op {
            Op::Open if self.port == Port::Closed => self.port = Port::Waiting,
            Op::Close if self.port != Port::Closed => {
                self.port = Port::Closed;
                if self.in_reach || !self.data_mode {
                    self.give_up_at = None;
                    self.disconnect();
                }
            }
            Op::Lose if self.in_reach => {
                self.in_reach = false;
                self.expect_give_up(now);
            }
            Op::Return if !self.in_reach => {
                self.in_reach = true;
                if self.data_mode {
                    self.give_up_at = None;
                    if self.port != Port::Connected {
                        self.disconnect();
                    }
                }
            }
            Op::PowerOff if self.powered => {
                self.expect_give_up(now);
                self.powered = false;
                self.data_mode = false;
                self.text.clear();
            }
            Op::PowerOn => self.powered = true,
            _ => {}
        }
        self.plan(now);
    }
}

#[derive(Clone, Debug)]
enum Op {
    Open,
    Close,
    Lose,
    Return,
    PowerOff,
    PowerOn,
    Wait(u64),
    Send(Vec<u8>),
}

/// Commands, damaged commands, and data.
fn text() -> impl Strategy<Value = Vec<u8>> {
    let command = prop_oneof![
        Just(b"AT".to_vec()),
        Just(b"AT+VERSION".to_vec()),
        "AT\\+NAME[a-z]{1,22}".prop_map(String::into_bytes),
        "AT\\+PIN[0-9]{3,5}".prop_map(String::into_bytes),
        "AT\\+BAUD[4-9A-D]".prop_map(String::into_bytes),
    ];
    prop_oneof![
        4 => command.clone(),
        1 => (command, any::<prop::sample::Index>(), any::<u8>()).prop_map(|(mut text, at, byte)| {
            let at = at.index(text.len());
            text[at] = byte;
            text
        }),
        1 => prop::collection::vec(any::<u8>(), 1..100),
    ]
}

fn op() -> impl Strategy<Value = Op> {
    prop_oneof![
        3 => Just(Op::Open),
        2 => Just(Op::Close),
        1 => Just(Op::Lose),
        2 => Just(Op::Return),
        1 => Just(Op::PowerOff),
        2 => Just(Op::PowerOn),
        6 => (1_u64..2_500).prop_map(Op::Wait),
        1 => (15_000_u64..25_000).prop_map(Op::Wait),
        6 => text().prop_map(Op::Send),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6 * ProptestConfig::default().cases))]

    /// Invariants over actions of host, radio, power and robot in any order: mode, memory and
    /// replies are the reference's, the rate in use is the stored one, and no byte is lost
    /// unnoticed.
    #[test]
    fn the_module_is_the_reference(ops in prop::collection::vec(op(), 1..40)) {
        let mut bench = Bench::new(Profile::default());
        let mut reference = Reference::new();
        let mut sent = Vec::new();
        for op in &ops {
            if let Op::PowerOff = op {
                // The model has no reply that is cut off, so wait until all of it was read.
                while !bench.radio.air.down.is_drained() {
                    bench.run_for(Duration::from_millis(20));
                }
            }
            reference.does(op, bench.now);
            match op {
                Op::Open => bench.open(),
                Op::Close => bench.close(),
                Op::Lose => bench.radio.set_radio(bench.now, Radio::Lost),
                Op::Return => bench.radio.set_radio(bench.now, Radio::InReach),
                Op::PowerOff => bench.radio.power_off(bench.now),
                Op::PowerOn => bench.radio.power_on(bench.now),
                Op::Wait(ms) => bench.run_for(Duration::from_millis(*ms)),
                Op::Send(text) => {
                    let line = bench.radio.line_config(Hc06::UART);
                    let start = bench.now;
                    for (&byte, count) in text.iter().zip(1..) {
                        reference.byte(byte, start + line.bytes_time(count));
                    }
                    bench.robot_sends(text);
                    sent.extend_from_slice(text);
                }
            }
            reference.tick(bench.now);
            prop_assert_eq!(bench.radio.mode(), reference.mode());
            let settings = bench.radio.settings();
            prop_assert_eq!(&settings.name, &reference.name);
            prop_assert_eq!((settings.pin, settings.line.baud), (reference.pin, reference.baud));
        }
        bench.run_for(Duration::from_secs(2));
        reference.tick(bench.now);
        if reference.powered {
            prop_assert_eq!(bench.radio.line_config(Hc06::UART).baud, reference.baud);
        }
        prop_assert_eq!(text_of(&bench.robot), reference.replies);
        prop_assert!(is_part_of(&bench.host, &sent));
    }
}

/// Whether `got` is `sent` with nothing added, changed or reordered.
fn is_part_of(got: &[(Instant, u8)], sent: &[u8]) -> bool {
    let mut sent = sent.iter();
    got.iter().all(|(_, byte)| sent.any(|other| other == byte))
}

/// The rates that the strategy above can set are real ones.
#[test]
fn the_strategy_covers_real_and_unreal_rates() {
    assert_eq!(baud_of(b'4'), Some(9_600));
    assert_eq!(baud_of(b'D'), None);
}
