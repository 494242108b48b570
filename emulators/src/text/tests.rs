use super::*;
use crate::board::{HostLine, ResetOn};
use crate::quantity::tests::{car, sink, variable, world};
use crate::quantity::{SinkKind, ValueSource};
use crate::world::Command as Order;

fn command(request: &str, reply: &str) -> Command {
    Command {
        request: request.to_owned(),
        reply: Some(reply.to_owned()),
    }
}

fn config() -> TextConfig {
    let mut speed = variable("speed", ValueSource::Stored);
    speed.safe = Some(0);
    TextConfig {
        line: LineConfig::new_8n1(9600),
        terminator: b"\r\n".to_vec(),
        latency: Duration::from_millis(2),
        watchdog: Some(Duration::from_millis(500)),
        variables: vec![speed, variable("x", ValueSource::XMm)],
        commands: vec![
            command("SPEED {speed}", "OK {speed}"),
            command("WHERE?", "X {x}"),
        ],
        unknown: Some("ERR".to_owned()),
        refused: Some("RANGE".to_owned()),
        periodic: None,
        board: BoardConfig::default(),
        greeting: None,
    }
}

fn after(slave: &mut Text, millis: u64, line: &str) -> String {
    let at = Instant::from_millis(millis);
    let mut world = world();
    slave.receive(Text::UART, at, line.as_bytes());
    slave.poll(at, &mut world);
    slave.poll(at + Duration::from_millis(2), &mut world);
    let mut buf = [0; 512];
    let len = slave.transmit(Text::UART, &mut buf);
    String::from_utf8_lossy(&buf[..len]).into_owned()
}

fn rules(slave: &mut Text) -> Vec<&'static str> {
    slave
        .take_events()
        .into_iter()
        .map(|event| event.rule)
        .collect()
}

#[test]
fn requests_set_variables_and_replies_show_them() {
    let mut slave = Text::new(config()).expect("sound");
    assert_eq!(after(&mut slave, 1, "SPEED -42\r\n"), "OK -42\r\n");
    assert_eq!(after(&mut slave, 9, "WHERE?\r\n"), "X 1000\r\n");
    assert_eq!(after(&mut slave, 20, "SPE"), "");
    assert_eq!(
        after(&mut slave, 30, "ED 7\r\nWHERE?\r\n"),
        "OK 7\r\nX 1000\r\n"
    );
    assert_eq!(rules(&mut slave), [""; 0]);
}

#[test]
fn each_rule_finds_its_guilty_master() {
    let mut slave = Text::new(config()).expect("sound");
    assert_eq!(after(&mut slave, 1, "SPEED 101\r\n"), "RANGE\r\n");
    assert_eq!(after(&mut slave, 9, "SPEED\r\n"), "ERR\r\n");
    assert_eq!(
        after(&mut slave, 20, "SPEED 99999999999999999999\r\n"),
        "ERR\r\n"
    );
    let endless = "a".repeat(1_000);
    assert_eq!(after(&mut slave, 30, &endless), "");
    assert_eq!(after(&mut slave, 40, "\r\nWHERE?\r\n"), "X 1000\r\n");
    let flood = "WHERE?\r\n".repeat(20);
    assert_eq!(after(&mut slave, 50, &flood).lines().count(), 16);
    assert_eq!(
        rules(&mut slave),
        [
            "out-of-range",
            "unknown-request",
            "line-too-long",
            "queue-full"
        ]
    );
}

/// 256 bytes are waited for, the 257th is one too many.
#[test]
fn a_line_is_waited_for_up_to_256_bytes() {
    let mut slave = Text::new(config()).expect("sound");
    after(&mut slave, 1, &"a".repeat(256));
    assert_eq!(rules(&mut slave), [""; 0]);
    after(&mut slave, 300, "a");
    assert_eq!(rules(&mut slave), ["line-too-long"]);
}

#[test]
fn values_are_safe_when_the_master_falls_silent() {
    let mut slave = Text::new(config()).expect("sound");
    after(&mut slave, 1, "SPEED 42\r\n");
    slave.poll(Instant::from_millis(500), &mut world());
    assert_eq!(rules(&mut slave), [""; 0]);
    slave.poll(Instant::from_millis(501), &mut world());
    assert_eq!(rules(&mut slave), ["made-safe"]);
}

#[test]
fn a_periodic_line_comes_once_a_period() {
    let mut slave = Text::new(TextConfig {
        periodic: Some(Periodic {
            line: "x={x}".to_owned(),
            period: Duration::from_millis(100),
        }),
        ..config()
    })
    .expect("sound");
    let mut lines = Vec::new();
    for millis in 0..=300 {
        lines.push(after(&mut slave, millis, "\r"));
    }
    assert_eq!(lines.concat(), "x=1000\r\n".repeat(3));
}

#[test]
fn descriptions_that_contradict_themselves_are_refused() {
    let fault = |request: &str, reply: &str| {
        let commands = vec![command(request, reply)];
        Text::new(TextConfig {
            commands,
            ..config()
        })
        .err()
    };
    let wrong = |key, text: &str| Some(TextError::Command(0, key, text.to_owned()));
    assert_eq!(
        fault("A {b}", ""),
        wrong("request", "\"A {b}\": there is no variable \"b\"")
    );
    assert_eq!(fault("A", "{x"), wrong("reply", "\"{x\" has a { without }"));
    assert_eq!(
        fault("A {x}", ""),
        wrong("request", "\"A {x}\": x has a source and cannot be set")
    );
    assert!(fault("{speed}{speed}", "").is_some());
    assert!(fault("", "").is_some());
}

/// A count is 10 mm/s, so 42 counts are 0.42 m/s. The car receives the order in the poll after the
/// line. After 500 ms of silence it is ordered to stand.
#[test]
fn a_variable_that_is_set_drives_its_actuator() {
    let mut config = config();
    config.variables[0].drives = Some(sink("drive", 0.01, SinkKind::Speed));
    let mut slave = Text::new(config).expect("sound");
    let mut world = car();
    assert_eq!(slave.check_chassis(world.chassis()), Ok(()));
    let at = Instant::from_millis(1);
    slave.receive(Text::UART, at, b"SPEED 42\r\n");
    assert_eq!(slave.poll_at(), Some(at));
    slave.poll(at, &mut world);
    assert_eq!(world.chassis().command(0), Order::Speed(0.42));
    slave.poll(Instant::from_millis(501), &mut world);
    assert_eq!(world.chassis().command(0), Order::Speed(0.0));
}

/// A builder that did not call [`Text::check_chassis`] finds the error in the log.
#[test]
fn an_actuator_that_is_not_there_is_noted_and_harms_nothing() {
    let mut config = config();
    config.variables[0].drives = Some(sink("drive", 0.01, SinkKind::Speed));
    let mut slave = Text::new(config).expect("sound");
    assert_eq!(after(&mut slave, 1, "SPEED 42\r\n"), "OK 42\r\n");
    assert_eq!(rules(&mut slave), ["not-driven"]);
}

/// Text sent by a slave on a board within the millisecond from `millis` on.
fn said(slave: &mut Text, millis: u64) -> String {
    let mut world = world();
    slave.poll(Instant::from_millis(millis), &mut world);
    slave.poll(Instant::from_millis(millis + 2), &mut world);
    let mut buf = [0; 512];
    let len = slave.transmit(Text::UART, &mut buf);
    String::from_utf8_lossy(&buf[..len]).into_owned()
}

fn on_board(resets_on: ResetOn) -> Text {
    Text::new(TextConfig {
        board: BoardConfig {
            resets_on: Some(resets_on),
            raises: vec![(HostLine::Dcd, "speed".to_owned())],
            ..BoardConfig::default()
        },
        greeting: Some("ready".to_owned()),
        watchdog: None,
        ..config()
    })
    .expect("sound")
}

/// The capacitor lets the edge through, not the level: DTR that stays on, or goes off, does
/// nothing.
/// 1.6 s after the edge at 100 ms the board greets, has forgotten its speed, and receives again.
#[test]
fn a_rising_dtr_starts_the_board_anew() {
    let mut slave = on_board(ResetOn::Dtr);
    assert_eq!(after(&mut slave, 10, "SPEED 7\r\n"), "OK 7\r\n");
    let at = Instant::from_millis(100);
    slave.receive(RESET_PIN, at, &[1]);
    slave.receive(Text::UART, Instant::from_millis(200), b"SPEED 9\r\n");
    assert_eq!(said(&mut slave, 1_697), "", "a millisecond too early");
    assert_eq!(said(&mut slave, 1_700), "ready\r\n");
    assert_eq!(rules(&mut slave), ["board-reset", "board-deaf"]);
    slave.receive(RESET_PIN, Instant::from_millis(1_800), &[1]);
    slave.receive(RESET_PIN, Instant::from_millis(1_810), &[0]);
    assert_eq!(after(&mut slave, 1_820, "SPEED 5\r\n"), "OK 5\r\n");
    assert_eq!(rules(&mut slave), [""; 0], "neither is an edge");
    slave.receive(RESET_PIN, Instant::from_millis(1_900), &[1]);
    assert_eq!(rules(&mut slave), ["board-reset"]);
}

/// A device that a break does not reset receives a NUL before its next line, as a UART does.
#[test]
fn a_break_is_a_nul_or_a_reset() {
    let mut slave = on_board(ResetOn::Dtr);
    let at = Instant::from_millis(10);
    slave.line_event(Text::UART, at, LineEvent::Break);
    assert_eq!(after(&mut slave, 20, "WHERE?\r\n"), "ERR\r\n");
    assert_eq!(rules(&mut slave), ["break", "unknown-request"]);
    let mut slave = on_board(ResetOn::Break);
    slave.line_event(Text::UART, at, LineEvent::Break);
    assert_eq!(said(&mut slave, 1_610), "ready\r\n");
    assert_eq!(rules(&mut slave), ["board-reset"]);
}

/// The line is on while the value is not 0, and each change is reported once. It is off while the
/// board starts.
#[test]
fn a_modem_line_follows_a_value() {
    let mut slave = on_board(ResetOn::Break);
    let level = |slave: &mut Text, millis: u64| {
        slave.poll(Instant::from_millis(millis), &mut world());
        let mut buf = [9; 4];
        match slave.transmit(HostLine::Dcd.port(), &mut buf) {
            1 => Some(buf[0]),
            _ => None,
        }
    };
    assert_eq!(level(&mut slave, 1), None);
    after(&mut slave, 10, "SPEED 3\r\n");
    assert_eq!(level(&mut slave, 20), Some(1));
    assert_eq!(level(&mut slave, 30), None);
    slave.line_event(Text::UART, Instant::from_millis(40), LineEvent::Break);
    assert_eq!(level(&mut slave, 41), Some(0));
    let unknown = Text::new(TextConfig {
        board: BoardConfig {
            raises: vec![(HostLine::Cts, "none".to_owned())],
            ..BoardConfig::default()
        },
        ..config()
    });
    let message = "there is no variable \"none\"".to_owned();
    assert_eq!(unknown.err(), Some(TextError::Key("raises", message)));
}

/// The board ignores other events than a break, and breaks on other lines.
#[test]
fn only_a_break_on_its_own_line_is_heard() {
    let mut slave = on_board(ResetOn::Break);
    let at = Instant::from_millis(10);
    slave.line_event(Text::UART, at, LineEvent::Opened);
    slave.line_event(Text::UART, at, LineEvent::FramingError);
    slave.line_event(RESET_PIN, at, LineEvent::Break);
    assert_eq!(after(&mut slave, 20, "WHERE?\r\n"), "X 1000\r\n");
    assert_eq!(rules(&mut slave), [""; 0]);
}

/// The line's own settings are those of the UART; pins have the settings of a level.
#[test]
fn the_uart_has_the_line_s_settings() {
    let slave = Text::new(config()).expect("sound");
    assert_eq!(slave.line_config(Text::UART), LineConfig::new_8n1(9600));
    assert_eq!(slave.line_config(HostLine::Cts.port()), PIN_LINE);
}

/// "OK 7" is four bytes and its end two: 4096 bytes wait for a line that takes none, as long as a
/// reply without its end fits.
#[test]
fn replies_wait_for_the_line_up_to_a_limit() {
    let mut slave = Text::new(config()).expect("sound");
    let mut world = world();
    for millis in (0..3_000).step_by(3) {
        slave.receive(Text::UART, Instant::from_millis(millis), b"SPEED 7\r\n");
        slave.poll(Instant::from_millis(millis + 2), &mut world);
    }
    // 682 replies are 4092 bytes; the next one still fits, but for its end.
    let mut buf = vec![0; 9_000];
    assert_eq!(slave.transmit(Text::UART, &mut buf), 683 * 6);
    assert!(buf.starts_with(b"OK 7\r\nOK 7\r\n"));
}

/// After a reset at 1 s a board works at 2.6 s; its first line follows a period later.
#[test]
fn a_board_that_starts_anew_begins_its_periods_when_it_is_up() {
    let mut slave = Text::new(TextConfig {
        periodic: Some(Periodic {
            line: "x={x}".to_owned(),
            period: Duration::from_millis(100),
        }),
        board: BoardConfig {
            resets_on: Some(ResetOn::Break),
            ..BoardConfig::default()
        },
        ..config()
    })
    .expect("sound");
    slave.line_event(Text::UART, Instant::from_millis(1_000), LineEvent::Break);
    let first = (1_000..4_000).find(|millis| {
        slave.poll(Instant::from_millis(*millis), &mut world());
        slave.transmit(Text::UART, &mut [0; 64]) > 0
    });
    assert_eq!(first, Some(2_700));
}

/// A board that is reset at 1 s receives again from 2.6 s on.
#[test]
fn a_board_hears_from_the_moment_that_it_is_up() {
    for (millis, heard) in [(2_599, ""), (2_600, "ready\r\nX 1000\r\n")] {
        let mut slave = on_board(ResetOn::Break);
        slave.line_event(Text::UART, Instant::from_millis(1_000), LineEvent::Break);
        let said = after(&mut slave, millis, "WHERE?\r\n");
        assert!(
            said == heard || heard.is_empty() && !said.contains('X'),
            "{millis}: {said}"
        );
    }
}

#[test]
fn values_are_those_of_all_variables() {
    let mut slave = Text::new(config()).expect("sound");
    let now = Instant::from_millis(5);
    slave.set(now, "speed", -7).expect("it is stored");
    assert_eq!(slave.values(now, &world()), [-7, 1_000]);
}
