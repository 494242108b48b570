use super::*;

/// A raw terminal with these input modes.
fn raw(input: u32) -> Terminal {
    let settings = Settings {
        input,
        control: bits::CSIZE | bits::CREAD,
        ..Settings::default()
    };
    Terminal::whole(settings)
}

/// A canonical one with Linux' usual special characters.
fn canonical(input: u32, output: u32, local: u32) -> Terminal {
    let mut usual = [0; Settings::LEN];
    usual[17..36].copy_from_slice(&[
        3, 28, 127, 21, 4, 0, 1, 0, 17, 19, 26, 0, 18, 15, 23, 22, 0, 0, 0,
    ]);
    let settings = Settings {
        input,
        output,
        control: bits::CSIZE | bits::CREAD,
        local: local | bits::ICANON,
        ..Settings::default().with(&usual)
    };
    let settings = Settings {
        input,
        output,
        control: bits::CSIZE,
        local: local | bits::ICANON,
        ..settings
    };
    Terminal::whole(settings)
}

fn mark(before: usize, value: u8, damage: MarkDamage) -> Mark {
    Mark {
        before,
        value,
        damage,
    }
}

/// termios(3): without INPCK a damaged character is a normal one. With INPCK it is 0; with PARMRK,
/// FF 00 and the character; with IGNPAR, nothing. A break is 0; with PARMRK, FF 00 00; with IGNBRK,
/// nothing.
#[test]
fn damaged_characters_appear_as_the_settings_say() {
    use MarkDamage::{Break, Framing, Parity};
    let read = |input| {
        let marks = [
            mark(0, 0x41, Parity),
            mark(1, 0x42, Framing),
            mark(2, 0, Break),
        ];
        raw(input).receive(b"ab", &marks).ready
    };
    assert_eq!(read(0), b"\x41a\x42b\0");
    assert_eq!(read(bits::INPCK), b"\0a\0b\0");
    assert_eq!(read(bits::INPCK | bits::IGNPAR), b"ab\0");
    let marked = bits::INPCK | bits::PARMRK;
    assert_eq!(read(marked), b"\xFF\0\x41a\xFF\0\x42b\xFF\0\0");
    assert_eq!(read(marked | bits::IGNBRK), b"\xFF\0\x41a\xFF\0\x42b");
    assert_eq!(read(bits::IGNBRK), b"\x41a\x42b");
    // With BRKINT a break discards waiting bytes.
    assert_eq!(read(bits::BRKINT), b"");
    let mut flushed = raw(bits::BRKINT);
    assert!(flushed.receive(b"", &[mark(0, 0, Break)]).flushes);
}

#[test]
fn with_marks_a_sound_ff_comes_twice() {
    assert_eq!(raw(0).receive(b"\xFF", &[]).ready, b"\xFF");
    assert_eq!(raw(bits::PARMRK).receive(b"\xFF", &[]).ready, b"\xFF\xFF");
    let strips = bits::PARMRK | bits::ISTRIP;
    assert_eq!(raw(strips).receive(b"\xFF", &[]).ready, b"\x7F");
}

#[test]
fn a_line_is_read_as_a_whole_and_edited_before() {
    let mut terminal = canonical(0, 0, bits::IEXTEN);
    assert_eq!(terminal.receive(b"helo\x7Flo", &[]).ready, b"");
    assert_eq!(terminal.readable(99), None);
    assert_eq!(terminal.receive(b"\nnext", &[]).ready, b"hello\n");
    assert_eq!(terminal.readable(3), Some(3));
    terminal.took(3);
    assert_eq!(terminal.readable(99), Some(3));
    terminal.took(3);
    // End of file ends a line without a character; on an empty line it is the end of input.
    assert_eq!(terminal.receive(b"\x17last\x04\x04", &[]).ready, b"last");
    assert_eq!(terminal.readable(99), Some(4));
    terminal.took(4);
    assert_eq!(terminal.readable(99), Some(0));
    terminal.took(0);
    assert_eq!(terminal.readable(99), None);
    // A literal character, and the deletion of the whole line.
    assert_eq!(
        terminal.receive(b"gone\x15a\x16\x04\n", &[]).ready,
        b"a\x04\n"
    );
}

#[test]
fn leaving_canonical_mode_gives_what_was_begun() {
    let mut terminal = canonical(0, 0, 0);
    assert_eq!(terminal.receive(b"ab", &[]).ready, b"");
    let raw = Settings {
        local: 0,
        ..*terminal.settings()
    };
    assert_eq!(terminal.set(raw), b"ab");
    assert_eq!(terminal.readable(9), Some(2));
    // Bytes that are there at the beginning count as a line.
    let canonical = Settings {
        local: bits::ICANON,
        ..raw
    };
    assert_eq!(terminal.set(canonical), b"");
    assert_eq!(terminal.readable(9), Some(2));
}

#[test]
fn cr_and_lf_are_translated_both_ways() {
    let read = |input| canonical(input, 0, 0).receive(b"a\r\n", &[]).ready;
    assert_eq!(read(0), b"a\r\n");
    assert_eq!(read(bits::ICRNL), b"a\n\n");
    assert_eq!(read(bits::IGNCR), b"a\n");
    let sent = |output| canonical(0, output | bits::OPOST, 0).send(b"a\r\n\tb");
    assert_eq!(sent(0), b"a\r\n\tb");
    assert_eq!(sent(bits::ONLCR), b"a\r\r\n\tb");
    assert_eq!(sent(bits::OCRNL), b"a\n\n\tb");
    assert_eq!(sent(bits::TABDLY), b"a\r\n        b");
    assert_eq!(canonical(0, 0, 0).send(b"\n"), b"\n");
}

#[test]
fn echo_is_what_the_far_end_gets() {
    let echo = |local, bytes: &[u8]| {
        let mut terminal = canonical(0, bits::OPOST | bits::ONLCR, local | bits::ECHO);
        terminal.receive(bytes, &[]);
        terminal.take_own()
    };
    assert_eq!(echo(0, b"ok\n"), b"ok\r\n");
    assert_eq!(echo(bits::ECHOCTL, b"\x01"), b"^A");
    assert_eq!(echo(bits::ECHOE, b"x\x7F"), b"x\x08 \x08");
    let mut quiet = canonical(0, 0, 0);
    quiet.receive(b"ok\n", &[]);
    assert_eq!(quiet.take_own(), b"");
}

#[test]
fn xoff_stops_the_client_until_xon() {
    let mut terminal = canonical(bits::IXON, 0, 0);
    assert_eq!(terminal.receive(b"a\x13b", &[]).ready, b"");
    assert!(terminal.is_stopped());
    terminal.receive(b"\x11\n", &[]);
    assert!(!terminal.is_stopped());
    assert_eq!(terminal.unread(), 3);
    terminal.send_flow(true);
    assert_eq!(terminal.take_own(), [0x13]);
}

/// A terminal holds 4095 bytes; further ones are lost and counted.
#[test]
fn what_has_no_room_is_counted() {
    let mut terminal = raw(0);
    let received = terminal.receive(&[7; 5000], &[]);
    assert_eq!((received.ready.len(), received.lost), (HOLDS, 5000 - HOLDS));
    terminal.forget();
    assert_eq!(terminal.receive(b"on", &[]).ready, b"on");
}

#[test]
fn fewer_bits_are_fewer_bits_both_ways() {
    let settings = Settings {
        control: 0o40,
        ..Settings::default()
    };
    let mut terminal = Terminal::whole(settings);
    assert_eq!(terminal.receive(b"\xC1", &[]).ready, b"\x41");
    assert_eq!(terminal.send(b"\xC1"), b"\x41");
    assert_eq!(settings.coding(), "7N1");
}

#[test]
fn settings_read_back_as_they_were_set() {
    let mut bytes = [0; Settings::LEN_WITH_SPEEDS];
    for (place, byte) in bytes.iter_mut().zip(1..) {
        *place = byte;
    }
    let set = Settings::default().with(&bytes);
    assert_eq!(set.bytes(), bytes);
    // Eight bits, even parity: 8E1.
    let set = Settings {
        control: 0o60 | 0o400,
        ..Settings::default()
    };
    assert_eq!(set.coding(), "8E1");
    let old: [u8; Settings::LEN_OLD] = set.bytes_old();
    assert_eq!(Settings::default().with_old(&old), set);
}
