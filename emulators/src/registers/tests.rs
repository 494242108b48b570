//! A small table against frames written out by hand: the sums are those of the bytes before them.

use super::*;
use crate::quantity::tests::{sink, variable, world};
use crate::quantity::{SinkKind, ValueSource};
use crate::world::{Drive, Wheel};

const LATENCY: Duration = Duration::from_micros(200);
const WATCHDOG: Duration = Duration::from_millis(500);

fn register(address: u8, width: Width, access: Access, source: ValueSource) -> Register {
    let mut variable = variable(&format!("at-{address}"), source);
    variable.limits = width.limits();
    Register {
        address,
        width,
        access,
        variable,
    }
}

/// Register 1: a signed byte for writing, -50 to 50, safe at 0; 2 and 3: millimetres along x.
fn table() -> Vec<Register> {
    let mut speed = register(1, Width::I8, Access::Write, ValueSource::Stored);
    speed.variable.limits = [-50, 50];
    speed.variable.safe = Some(0);
    vec![
        speed,
        register(2, Width::I16, Access::Read, ValueSource::XMm),
        register(8, Width::U16, Access::Write, ValueSource::Stored),
    ]
}

fn slave_with(registers: Vec<Register>) -> Result<Registers, VariableError> {
    Registers::new(RegistersConfig {
        line: LineConfig::new_8n1(115_200),
        order: ChecksumOrder::LowFirst,
        latency: LATENCY,
        idle_gap: Duration::from_millis(2),
        watchdog: Some(WATCHDOG),
        registers,
        board: BoardConfig::default(),
    })
}

fn slave() -> Registers {
    slave_with(table()).expect("sound")
}

/// The slave's answer to bytes that end at `millis`, within 10 ms.
fn asked(slave: &mut Registers, millis: u64, bytes: &[u8]) -> Vec<u8> {
    let mut world = world();
    let at = Instant::from_millis(millis);
    slave.receive(Registers::BUS, at, bytes);
    slave.poll(at, &mut world);
    let mut buf = [0; 256];
    if bytes.len() < 10 {
        assert_eq!(slave.transmit(Registers::BUS, &mut buf), 0, "too early");
    }
    slave.poll(at + LATENCY, &mut world);
    slave.poll(at + Duration::from_millis(10), &mut world);
    let len = slave.transmit(Registers::BUS, &mut buf);
    buf[..len].to_vec()
}

fn rules(slave: &mut Registers) -> Vec<&'static str> {
    slave
        .take_events()
        .into_iter()
        .map(|event| event.rule)
        .collect()
}

/// The checksum of the request is AB + 02 + 02 = AF. The value x is 1000 = 03E8, and the checksum
/// of the reply is AB + 02 + 82 + E8 + 03 = 21A.
#[test]
fn a_value_of_the_world_is_read_low_byte_first() {
    let mut slave = slave();
    let reply = asked(&mut slave, 1, &[0xAB, 2, 2, 0xAF, 0x00]);
    assert_eq!(reply, [0xAB, 2, 0x82, 0xE8, 0x03, 0x1A, 0x02]);
    assert_eq!(rules(&mut slave), [""; 0]);
}

/// The value -20 is EC, and the write's checksum AB + 01 + 81 + EC = 219. The acknowledgement's
/// checksum is AB + 01 = AC.
#[test]
fn a_written_value_is_acknowledged_and_read_back() {
    let mut slave = slave();
    let reply = asked(&mut slave, 1, &[0xAB, 1, 0x81, 0xEC, 0x19, 0x02]);
    assert_eq!(reply, [0xAB, 1, 0, 0xAC, 0x00]);
    let reply = asked(&mut slave, 20, &[0xAB, 1, 1, 0xAD, 0x00]);
    assert_eq!(reply, [0xAB, 1, 0x81, 0xEC, 0x19, 0x02]);
    assert_eq!(rules(&mut slave), [""; 0]);
}

/// 500 ms after the last valid frame the value is the safe one; a frame in between keeps it.
#[test]
fn values_are_safe_when_the_master_falls_silent_and_not_before() {
    let mut slave = slave();
    asked(&mut slave, 0, &[0xAB, 1, 0x81, 0xEC, 0x19, 0x02]);
    let read = [0xAB, 1, 1, 0xAD, 0x00];
    assert_eq!(asked(&mut slave, 490, &read)[3], 0xEC);
    assert_eq!(asked(&mut slave, 980, &read)[3], 0xEC);
    assert_eq!(
        asked(&mut slave, 1481, &read)[3],
        0xEC,
        "read before the poll"
    );
    let mut world = world();
    slave.poll(Instant::from_millis(1981), &mut world);
    assert_eq!(asked(&mut slave, 1990, &read)[3], 0);
    assert_eq!(rules(&mut slave), ["made-safe"]);
}

#[test]
fn each_rule_finds_its_guilty_master() {
    let guilty = |bytes: &[u8]| {
        let mut slave = slave();
        let reply = asked(&mut slave, 1, bytes);
        (rules(&mut slave), reply)
    };
    // The error frame: AB + FF = 1AA, low byte first here.
    let error = vec![0xAB, 0xFF, 0, 0xAA, 0x01];
    assert_eq!(
        guilty(&[0xAB, 2, 2, 0xB0, 0x00]),
        (vec!["bad-checksum"], error)
    );
    assert_eq!(guilty(&[0x55]), (vec!["stray-bytes"], vec![]));
    assert_eq!(guilty(&[0xAB, 2]).0, ["frame-cut-off"]);
    assert_eq!(guilty(&[0xAB, 3, 2, 0xB0, 0x00]).0, ["unknown-register"]);
    assert_eq!(
        guilty(&[0xAB, 2, 0x82, 1, 1, 0x31, 0x01]).0,
        ["write-read-only"]
    );
    assert_eq!(guilty(&[0xAB, 8, 0x81, 1, 0x35, 0x01]).0, ["value-cut"]);
    // The value 51, 33 hex, is one more than allowed; the checksum is AB + 01 + 81 + 33 = 160.
    assert_eq!(guilty(&[0xAB, 1, 0x81, 51, 0x60, 0x01]).0, ["out-of-range"]);
    let hasty = [0xAB, 2, 2, 0xAF, 0x00].repeat(2);
    assert_eq!(guilty(&hasty).0, ["request-before-reply"]);
    let flood = [0xAB, 2, 2, 0xAF, 0x00].repeat(6);
    assert_eq!(guilty(&flood).0, ["request-before-reply", "queue-full"]);
}

#[test]
fn a_value_out_of_range_becomes_the_nearest_allowed() {
    let mut slave = slave();
    asked(&mut slave, 1, &[0xAB, 1, 0x81, 51, 0x60, 0x01]);
    assert_eq!(asked(&mut slave, 20, &[0xAB, 1, 1, 0xAD, 0x00])[3], 50);
}

#[test]
fn tables_that_contradict_themselves_are_refused() {
    let fault = |register: Register| {
        let error = slave_with([table(), vec![register]].concat()).expect_err("unsound");
        assert_eq!(error.index, 3);
        error.message
    };
    let stored = || ValueSource::Stored;
    let lies = fault(register(3, Width::U8, Access::Read, stored()));
    assert_eq!(lies, "address 3 belongs to \"at-2\"");
    assert!(fault(register(254, Width::U16, Access::Read, stored())).contains("ends at 256"));
    assert!(fault(register(20, Width::U8, Access::Write, ValueSource::XMm)).contains("no effect"));
    let mut wide = register(20, Width::U8, Access::Read, stored());
    wide.variable.limits = [0, 256];
    assert!(fault(wide).contains("holds 0 to 255"));
}

/// A power of 5 a count: -20 are -100 of 255. The answer comes 200 us after the frame, and with it
/// the drive; 500 ms after the frame the value is safe and the wheel gets nothing more.
#[test]
fn a_written_register_drives_its_actuator_until_the_watchdog_bites() {
    let mut registers = table();
    registers[0].variable.drives = Some(sink("left", 5.0, SinkKind::Power));
    let mut slave = slave_with(registers).expect("sound");
    let mut world = world();
    let at = Instant::from_millis(1);
    slave.poll(at, &mut world);
    assert_eq!(world.drive(Wheel::Left), Drive::Brake, "0 at the start");
    slave.receive(Registers::BUS, at, &[0xAB, 1, 0x81, 0xEC, 0x19, 0x02]);
    slave.poll(at, &mut world);
    assert_eq!(world.drive(Wheel::Left), Drive::Brake, "not answered yet");
    slave.poll(at + LATENCY, &mut world);
    assert_eq!(world.drive(Wheel::Left), Drive::Power(-100));
    world.set_drive(Wheel::Left, Drive::Coast);
    slave.poll(Instant::from_millis(500), &mut world);
    assert_eq!(world.drive(Wheel::Left), Drive::Coast, "nothing changed");
    assert_eq!(slave.clone().poll_at(), Some(Instant::from_millis(501)));
    slave.poll(Instant::from_millis(501), &mut world);
    assert_eq!(world.drive(Wheel::Left), Drive::Power(0));
    assert_eq!(rules(&mut slave), ["made-safe"]);
}

#[test]
fn a_register_that_only_the_device_changes_drives_nothing() {
    let mut register = register(20, Width::U8, Access::Read, ValueSource::Stored);
    register.variable.drives = Some(sink("left", 1.0, SinkKind::Power));
    let error = slave_with(vec![register]).expect_err("unsound");
    assert!(error.message.contains("a master must be able to write it"));
}

#[test]
fn a_table_for_another_chassis_is_found_out() {
    let mut registers = table();
    registers[2].variable.drives = Some(sink("steering", 0.01, SinkKind::Angle));
    let slave = slave_with(registers).expect("sound");
    assert_eq!(slave.wanted().count(), 1);
    let error = slave.check_chassis(world().chassis()).expect_err("no car");
    assert_eq!(
        (error.index, error.message.as_str()),
        (
            2,
            "there is no actuator \"steering\", expected one of: left, right"
        )
    );
}

/// Whatever a master sends, the slave lives and its memory stays small.
#[test]
fn random_bytes_do_not_harm_the_slave() {
    let mut rng = crate::rng::Rng::stream(7, "test.bytes");
    let (mut slave, mut world) = (slave(), world());
    for millis in 0..3_000 {
        let bytes = [(); 5].map(|()| rng.next_u64().to_le_bytes()).concat();
        slave.receive(Registers::BUS, Instant::from_millis(millis), &bytes);
        slave.poll(Instant::from_millis(millis), &mut world);
        let _ = slave.transmit(Registers::BUS, &mut [0; 64]);
    }
    assert!(slave.pending.len() <= QUEUE_MAX && slave.output.len() < 1_000);
}

/// Register 1 held 7; after a break it is 0 again, and a request during the board's start is lost.
#[test]
fn a_break_starts_the_board_anew() {
    let mut slave = Registers::new(RegistersConfig {
        board: BoardConfig {
            resets_on: Some(crate::board::ResetOn::Break),
            boot: Some(Duration::from_millis(300)),
            ..BoardConfig::default()
        },
        line: LineConfig::new_8n1(115_200),
        order: ChecksumOrder::LowFirst,
        latency: LATENCY,
        idle_gap: Duration::from_millis(2),
        watchdog: None,
        registers: table(),
    })
    .expect("sound");
    let order = ChecksumOrder::LowFirst;
    let frame = |frame: Frame| frame.as_bytes().to_vec();
    let (write, read) = (
        frame(Frame::write(1, &[7], order)),
        frame(Frame::read(1, 1, order)),
    );
    asked(&mut slave, 10, &write);
    assert_eq!(
        asked(&mut slave, 50, &read),
        write,
        "it holds what it was told"
    );
    slave.line_event(Registers::BUS, Instant::from_millis(100), LineEvent::Break);
    assert_eq!(asked(&mut slave, 390, &read), [0_u8; 0]);
    let forgotten = frame(Frame::write(1, &[0], order));
    assert_eq!(asked(&mut slave, 410, &read), forgotten);
}

/// Only a break on the bus itself: it is received as a NUL, which begins no frame.
#[test]
fn a_break_on_the_bus_is_heard_as_a_nul() {
    let told = |port, event| {
        let mut slave = slave();
        slave.line_event(port, Instant::from_millis(3), event);
        rules(&mut slave)
    };
    assert_eq!(
        told(Registers::BUS, LineEvent::Break),
        ["break", "stray-bytes"]
    );
    assert_eq!(told(Registers::BUS, LineEvent::FramingError), [""; 0]);
    assert_eq!(told(RESET_PIN, LineEvent::Break), [""; 0]);
    assert_eq!(told(RESET_PIN, LineEvent::Opened), [""; 0]);
}

#[test]
fn the_bus_has_the_line_s_settings() {
    let slave = slave();
    assert_eq!(
        slave.line_config(Registers::BUS),
        LineConfig::new_8n1(115_200)
    );
    assert_eq!(slave.line_config(RESET_PIN), PIN_LINE);
}

/// One, two and four bytes, without sign and in two's complement.
#[test]
fn a_width_holds_from_its_least_to_its_greatest_value() {
    use Width::{I8, I16, I32, U8, U16, U32};
    assert_eq!([U8, I8].map(Width::limits), [[0, 255], [-128, 127]]);
    assert_eq!(
        [U16, I16].map(Width::limits),
        [[0, 65_535], [-32_768, 32_767]]
    );
    let limits = [[0, 4_294_967_295], [-2_147_483_648, 2_147_483_647]];
    assert_eq!([U32, I32].map(Width::limits), limits);
}

/// x is 1000 mm; the others are stored and begin at 0.
#[test]
fn values_are_those_of_the_table_in_its_order() {
    let mut slave = slave();
    assert_eq!(slave.values(Instant::ZERO, &world()), [0, 1_000, 0]);
    assert_eq!(slave.set(Instant::ZERO, "at-8", 700), Ok(()));
    assert_eq!(slave.values(Instant::ZERO, &world()), [0, 1_000, 700]);
    let reasons = [
        ("at-1", 51, "-50 to 50"),
        ("at-2", 1, "own source"),
        ("at-9", 1, "at-1, at-2"),
    ];
    for (name, value, reason) in reasons {
        let error = slave.set(Instant::ZERO, name, value).unwrap_err();
        assert!(error.contains(reason), "{error}");
    }
    assert_eq!(slave.values(Instant::ZERO, &world()), [0, 1_000, 700]);
}

/// Address 255 is that of the error frame: a value ends before it. Two values may touch.
#[test]
fn a_table_ends_before_the_error_register() {
    let table = |places: &[(u8, Width)]| {
        let registers = places
            .iter()
            .map(|&(address, width)| register(address, width, Access::Write, ValueSource::Stored));
        slave_with(registers.collect())
            .map(|_| ())
            .map_err(|error| error.message)
    };
    for place in [(254, Width::U8), (253, Width::I16), (251, Width::U32)] {
        assert_eq!(table(&[place]), Ok(()), "{place:?}");
    }
    for place in [(255, Width::I8), (254, Width::U16), (252, Width::I32)] {
        let message = "it ends at 256, expected before 255".to_owned();
        assert_eq!(table(&[place]), Err(message), "{place:?}");
    }
    assert_eq!(
        table(&[(1, Width::U16), (3, Width::U8), (0, Width::I8)]),
        Ok(())
    );
    let belongs = |address| Err(format!("address {address} belongs to \"at-1\""));
    assert_eq!(table(&[(1, Width::U16), (2, Width::U8)]), belongs(2));
    assert_eq!(table(&[(1, Width::U16), (0, Width::U16)]), belongs(0));
}
