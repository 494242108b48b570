//! Commands of the HC-06 radio, both ways.

use proptest::prelude::*;
use protocols::hc06::{BAUD_RATES, Command};
use protocols::line::Parity;

/// The command table of the linvor firmware, as module guides and a scripted set-up session give
/// it: upper case, no line end.
const TABLE: [(&str, Command<'static>); 12] = [
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

/// The module answers nothing to what it does not know; so nothing near a command may pass.
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
    assert_eq!(Command::Baud(14_400).encode(&mut [0; 32]), None);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// Telemetry reaches the command parser whenever the PC hangs up. What it takes for a command
    /// must be one: said again, it is the same bytes.
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
}
