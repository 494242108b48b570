//! Text for bytes outside of frames.

use protocols::hc06::{Command, LineCommand};

/// A free comment, escaped to one line.
pub fn one_line(comment: &str) -> String {
    let plain = |c: char| if c.is_control() { ' ' } else { c };
    comment.chars().map(plain).collect()
}

/// Text on a line; names text that an HC-06 would execute as a command.
pub fn text(bytes: &[u8]) -> String {
    let shown = bytes.escape_ascii();
    match at_command(bytes) {
        Some(words) => format!("AT command \"{shown}\": {words}"),
        None => format!("text \"{shown}\""),
    }
}

fn at_command(bytes: &[u8]) -> Option<String> {
    if let Some(line) = bytes.strip_suffix(b"\r\n") {
        return LineCommand::parse(line).map(|command| match command {
            LineCommand::Name(name) => format!("name is \"{}\"", name.escape_ascii()),
            LineCommand::Pin(pin) => format!("PIN is {}", pin.escape_ascii()),
            LineCommand::Uart(line) => format!("rate is {} baud", line.baud),
            other => format!("{other:?}"),
        });
    }
    Command::parse(bytes).map(|command| match command {
        Command::Name(name) => format!("name is \"{}\"", name.escape_ascii()),
        Command::Pin(pin) => format!("PIN is {}", pin.escape_ascii()),
        Command::Baud(rate) => format!("rate is {rate} baud"),
        other => format!("{other:?}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_of_the_radio_are_named() {
        assert_eq!(
            text(b"AT+BAUDA"),
            "AT command \"AT+BAUDA\": rate is 460800 baud"
        );
        assert_eq!(text(b"OKsetname"), "text \"OKsetname\"");
        let v3 = text(b"AT+NAME=rescue\r\n");
        assert_eq!(
            v3,
            "AT command \"AT+NAME=rescue\\r\\n\": name is \"rescue\""
        );
    }
}
