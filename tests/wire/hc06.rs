//! Commands of the HC-06 radio, both ways.

use proptest::prelude::*;
use protocols::hc06::{BAUD_RATES, Command, Led, LineCommand, Role};
use protocols::line::{LineConfig, Parity};

/// The command table of the linvor firmware, as module guides and a scripted set-up session give
/// it: upper case, no line end.
const TABLE: [(&str, Command<'static>); 15] = [
    ("AT", Command::Attention),
    ("AT+VERSION", Command::Version),
    ("AT+NAMErescue", Command::Name(b"rescue")),
    (
        "AT+NAME01234567890123456789",
        Command::Name(b"01234567890123456789"),
    ),
    ("AT+PIN1234", Command::Pin(*b"1234")),
    ("AT+BAUD1", Command::Baud(1_200)),
    ("AT+BAUD4", Command::Baud(9_600)),
    ("AT+BAUD8", Command::Baud(115_200)),
    ("AT+BAUDA", Command::Baud(460_800)),
    ("AT+PN", Command::Parity(Parity::None)),
    ("AT+PO", Command::Parity(Parity::Odd)),
    ("AT+PE", Command::Parity(Parity::Even)),
    // Only the 2.0 firmware has these three.
    ("AT+ROLE=S", Command::Role(Role::Slave)),
    ("AT+LED0", Command::Led(Led::Off)),
    ("AT+LED1", Command::Led(Led::On)),
];

const AT_230400: LineConfig = LineConfig::new_8n1(230_400);

/// The command set of firmware 3.0-20170609 as two public threads report it: CR LF at the end of
/// each line, values behind an equals sign.
const LINES: [(&str, LineCommand<'static>); 8] = [
    ("AT\r\n", LineCommand::Attention),
    ("AT+VERSION\r\n", LineCommand::Version),
    ("AT+NAME=rescue\r\n", LineCommand::Name(b"rescue")),
    ("AT+PSWD=\"1234\"\r\n", LineCommand::Pin(*b"1234")),
    ("AT+UART=230400,0,0\r\n", LineCommand::Uart(AT_230400)),
    ("AT+UART\r\n", LineCommand::AskUart),
    ("AT+ORGL\r\n", LineCommand::Restore),
    ("AT+RESET\r\n", LineCommand::Reset),
];

#[test]
fn commands_are_understood_and_said_as_in_the_table() {
    for (text, command) in TABLE {
        assert_eq!(Command::parse(text.as_bytes()), Some(command), "{text}");
        let mut out = [0; 32];
        let len = command.encode(&mut out).expect("fits");
        assert_eq!(out[..len], *text.as_bytes());
    }
}

#[test]
fn lines_are_understood_and_said_as_reported() {
    for (text, command) in LINES {
        let line = text.strip_suffix("\r\n").expect("a line");
        assert_eq!(
            LineCommand::parse(line.as_bytes()),
            Some(command),
            "{text:?}"
        );
        let mut out = [0; 40];
        let len = command.encode(&mut out).expect("fits");
        assert_eq!(out[..len], *text.as_bytes());
    }
}

/// A name of 21 characters, a PIN of letters, nine data bits: the module would not understand them,
/// so the encoder refuses them.
#[test]
fn what_cannot_be_understood_is_not_said() {
    let mut out = [0; 64];
    assert_eq!(
        Command::Name(b"012345678901234567890").encode(&mut out),
        None
    );
    assert_eq!(Command::Name(b"").encode(&mut out), None);
    assert_eq!(Command::Pin(*b"12a4").encode(&mut out), None);
    assert_eq!(Command::Baud(14_400).encode(&mut out), None);
    assert_eq!(LineCommand::Name(b"two\r\nlines").encode(&mut out), None);
    assert_eq!(LineCommand::Pin(*b"\"\"\"\"").encode(&mut out), None);
    let nine = LineConfig {
        data_bits: 9,
        ..AT_230400
    };
    assert_eq!(LineCommand::Uart(nine).encode(&mut out), None);
}

/// The module does not answer unknown commands, so no near miss of a command may pass.
#[test]
fn what_is_not_exactly_a_command_is_none() {
    let wrong = [
        "",
        "A",
        "at",
        "AT ",
        "AT+",
        "AT\r\n",
        "AT+VERSION?",
        "AT+NAME",
        "AT+PIN123",
        "AT+PIN12345",
        "AT+PIN12a4",
        "AT+BAUD",
        "AT+BAUD0",
        "AT+BAUDD",
        "AT+BAUDa",
        "AT+BAUD44",
        "AT+PX",
        "AT+PNN",
        "AT+NAME012345678901234567890",
        "OKAT",
    ];
    for text in wrong {
        assert_eq!(Command::parse(text.as_bytes()), None, "{text:?}");
    }
}

/// The letters of the twelve rates, from the module's table.
#[test]
fn each_baud_rate_has_its_character() {
    for (digit, rate) in b"123456789ABC".iter().zip(BAUD_RATES) {
        let text = [b"AT+BAUD".as_slice(), &[*digit]].concat();
        assert_eq!(Command::parse(&text), Some(Command::Baud(rate)));
    }
}

proptest! {
    #![proptest_config(crate::thorough::cases(20_000))]

    /// Telemetry reaches the command parser whenever the PC disconnects. A parsed command must be a
    /// real command: encoded again, it gives the same bytes.
    #[test]
    fn whatever_is_understood_can_be_said_again(
        start in proptest::sample::select(TABLE.map(|(text, _)| text).to_vec()),
        at: proptest::sample::Index,
        byte: u8,
    ) {
        let mut text = start.as_bytes().to_vec();
        *at.get_mut(&mut text) = byte;
        if let Some(command) = Command::parse(&text) {
            let mut out = [0; 32];
            let len = command.encode(&mut out).expect("fits");
            prop_assert_eq!(&out[..len], &text[..]);
        }
    }

    /// The same holds for lines; a question mark and a colon may be encoded differently.
    #[test]
    fn whatever_line_is_understood_can_be_said_again(
        start in proptest::sample::select(LINES.map(|(text, _)| text).to_vec()),
        at: proptest::sample::Index,
        byte in prop_oneof![any::<u8>(), proptest::sample::select(b"=:?\r\n\",".to_vec())],
    ) {
        let mut text = start.strip_suffix("\r\n").expect("a line").as_bytes().to_vec();
        *at.get_mut(&mut text) = byte;
        if let Some(command) = LineCommand::parse(&text) {
            let mut out = [0; 40];
            let len = command.encode(&mut out).expect("fits");
            prop_assert_eq!(LineCommand::parse(&out[..len - 2]), Some(command));
        }
    }
}
