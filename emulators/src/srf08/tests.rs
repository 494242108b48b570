//! The manual's figures, and a wall at a known distance.

use protocols::Port;

use super::*;
use crate::device::Device;
use crate::i2c::OnBus;
use crate::world::{BodyConfig, Fixture, Point, Pose, Shape};

/// A wall 1.234 m ahead, if any.
fn world(distance_m: Option<f64>) -> World {
    let wall = distance_m.map(|x| Shape::Wall {
        from: Point::new(x, -9.0),
        to: Point::new(x, 9.0),
    });
    let scene = Scene::new(wall.map(Fixture::from), vec![]).unwrap();
    World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap()
}

fn chip() -> Srf08 {
    Srf08::new(Srf08Config::default(), 1, "test")
}

fn echo(chip: &mut Srf08, now: Instant, world: &World) -> u16 {
    let mut bytes = [0; 2];
    chip.read(now, RANGE, &mut bytes, world);
    u16::from_be_bytes(bytes)
}

/// The result of a command after its ranging time.
fn range(world: &World, command: u8) -> u16 {
    let mut chip = chip();
    chip.write(Instant::ZERO, COMMAND, &[command], world);
    echo(&mut chip, Instant::from_secs(1), world)
}

/// The range register 255 is 256 * 43 mm = 11.008 m. There and back, 22.016 m at 343.2 m/s take
/// 64.149 ms, and 1 ms is added. The value 24 is 1.075 m: 7.265 ms in all.
#[test]
fn ap10_the_result_is_there_after_the_ranging_time_and_not_before() {
    let world = world(Some(1.0));
    let mut chip = chip();
    assert!(chip.acknowledges(Instant::ZERO, 0xE0));
    chip.write(Instant::ZERO, COMMAND, &[CENTIMETRES], &world);
    let before = Instant::from_micros(65_148);
    assert!(chip.is_ranging(before) && !chip.acknowledges(before, 0xE0));
    let mut revision = [0];
    chip.read(before, COMMAND, &mut revision, &world);
    assert_eq!(
        (revision, echo(&mut chip, before, &world)),
        ([0xFF], 0xFFFF)
    );
    let ready = Instant::from_micros(65_150);
    assert!(chip.acknowledges(ready, 0xE0));
    assert!((99..=101).contains(&echo(&mut chip, ready, &world)));
    chip.write(ready, RANGE, &[24], &world);
    let time = chip.ranging_time().as_secs_f64();
    assert!((time - 0.007_265).abs() < 1e-6, "{time}");
}

/// From 3 cm to 6 m the range is right to a centimetre, in all three units; nearer reads 3 cm.
#[test]
fn ap10_ranges_are_right_to_a_centimetre() {
    for distance_m in [0.20, 0.5, 1.234, 2.5, 5.9] {
        let world = world(Some(distance_m));
        let off = f64::from(range(&world, CENTIMETRES)) - 100.0 * distance_m;
        assert!(off.abs() <= 1.0, "{distance_m} m: {off} cm");
        let off_m = f64::from(range(&world, MICROSECONDS)) * 171.6e-6 - distance_m;
        assert!(off_m.abs() < 0.011, "{distance_m} m: {off_m} m");
        let off_m = f64::from(range(&world, INCHES)) * 0.0254 - distance_m;
        assert!(off_m.abs() < 0.024, "{distance_m} m: {off_m} m");
    }
}

#[test]
fn ap10_no_echo_reads_zero() {
    assert_eq!(range(&world(None), CENTIMETRES), 0);
    assert_eq!(range(&world(Some(6.1)), CENTIMETRES), 0);
    // A range of 1.075 m does not reach a wall at 1.234 m.
    let world = world(Some(1.234));
    let mut chip = chip();
    chip.write(Instant::ZERO, RANGE, &[24], &world);
    chip.write(Instant::ZERO, COMMAND, &[CENTIMETRES], &world);
    assert_eq!(echo(&mut chip, Instant::from_secs(1), &world), 0);
}

/// General call 0 starts all; A0, AA, A5 and a new address change the address.
#[test]
fn addresses_are_those_of_the_manual() {
    let world = world(Some(1.0));
    let mut chip = chip();
    let now = Instant::ZERO;
    assert!(chip.acknowledges(now, 0x00) && !chip.acknowledges(now, 0xE2));
    for byte in [0xA0, 0xAA, 0xA5, 0xE2] {
        chip.write(now, COMMAND, &[byte], &world);
    }
    assert!(chip.acknowledges(now, 0xE2) && !chip.acknowledges(now, 0xE0));
    for byte in [0xA0, 0xA5, 0xAA, 0xE4] {
        chip.write(now, COMMAND, &[byte], &world);
    }
    assert!(chip.acknowledges(now, 0xE2), "the order is wrong");
    let events = chip.log().0.take();
    assert!(events.iter().any(|event| event.rule == "unknown-command"));
}

#[test]
fn faults_are_heard() {
    let world = world(Some(1.0));
    let later = Instant::from_secs(1);
    let ranged = |fault: &str, figure| {
        let mut chip = chip();
        chip.set_fault(Instant::ZERO, fault, figure, true);
        chip.write(Instant::ZERO, COMMAND, &[CENTIMETRES], &world);
        let heard = echo(&mut chip, later, &world);
        chip.set_fault(later, fault, figure, false);
        chip.write(later, COMMAND, &[CENTIMETRES], &world);
        let mended = echo(&mut chip, Instant::from_secs(2), &world);
        assert!((99..=101).contains(&mended), "{fault}: {mended}");
        heard
    };
    assert_eq!(ranged("deaf", None), 0);
    assert_eq!(ranged("stuck", None), 0, "nothing was measured before");
    assert!((119..=121).contains(&ranged("wrong", Some(0.2))));
    let mut chip = chip();
    chip.set_fault(Instant::ZERO, "off", None, true);
    assert!(!chip.acknowledges(Instant::ZERO, 0xE0));
}

/// Over the bus: a command, a wait and a read. A read while the chip ranges gives all ones.
#[test]
fn a_bus_carries_its_transactions() {
    let mut world = world(Some(1.0));
    let mut device = OnBus::new(chip());
    let mut ask = |millis: u64, message: &[u8]| {
        let now = Instant::from_millis(millis);
        device.receive(Port(0), now, message);
        device.poll(device.poll_at().unwrap(), &mut world);
        let mut answer = [0; 8];
        let len = device.transmit(Port(0), &mut answer);
        answer[..len].to_vec()
    };
    assert_eq!(ask(0, &[0xE0, COMMAND, CENTIMETRES]), []);
    assert_eq!(ask(30, &[0xE0, RANGE]), []);
    assert_eq!(
        ask(30, &[0xE1, 2]),
        [0xFF, 0xFF],
        "no chip pulls the bus down"
    );
    assert_eq!(ask(70, &[0xE0, RANGE]), []);
    let answer = ask(70, &[0xE1, 2]);
    assert_eq!(answer.len(), 2);
    assert!((99..=101).contains(&answer[1]), "{answer:?}");
}

/// Revision, light, and a second echo that is not modelled.
#[test]
fn registers_beside_the_echo_are_read() {
    let world = world(None);
    let mut chip = chip();
    let mut bytes = [0xA5; 6];
    chip.read(Instant::ZERO, COMMAND, &mut bytes, &world);
    assert_eq!(bytes, [10, 128, 0, 0, 0, 0]);
    assert_eq!(chip.known_faults(), ["off", "deaf", "stuck", "wrong"]);
    chip.set_fault(Instant::ZERO, "off", None, true);
    chip.set_fault(Instant::ZERO, "off", None, false);
    assert!(chip.acknowledges(Instant::ZERO, 0xE0));
}

/// At the very end of the ranging time it acknowledges.
#[test]
fn ranging_ends_when_its_time_is_over() {
    let world = world(None);
    let mut chip = chip();
    chip.write(Instant::ZERO, COMMAND, &[CENTIMETRES], &world);
    let ready = Instant::ZERO + chip.ranging_time();
    assert!(!chip.is_ranging(ready));
}

/// After the three bytes a command still works, and the three do not count as unknown commands.
#[test]
fn only_an_address_changes_the_address() {
    let world = world(Some(1.0));
    let mut chip = chip();
    let now = Instant::ZERO;
    for byte in [0xA0, 0xAA, 0xA5, CENTIMETRES] {
        chip.write(now, COMMAND, &[byte], &world);
    }
    let later = Instant::from_secs(1);
    assert!(chip.acknowledges(later, 0xE0));
    assert!((99..=101).contains(&echo(&mut chip, later, &world)));
    assert!(chip.log().0.take().is_empty());
}

/// A wall 1 m to the left is 0.7 m away from a chip that looks left and sits 0.3 m to the left. A
/// chip that looks to the right receives nothing. A wall 0.2 m ahead of the robot is 1 cm ahead of
/// a chip that sits 0.19 m ahead: it reads the least, 3 cm.
#[test]
fn a_chip_hears_from_where_it_sits() {
    let wall = Shape::Wall {
        from: Point::new(-9.0, 1.0),
        to: Point::new(9.0, 1.0),
    };
    let scene = Scene::new([Fixture::from(wall)], vec![]).unwrap();
    let beside = World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap();
    let heard = |x_m, y_m, yaw_rad, world: &World| {
        let config = Srf08Config {
            x_m,
            y_m,
            yaw_rad,
            noise_m: 0.0,
            ..Srf08Config::default()
        };
        let mut chip = Srf08::new(config, 1, "test");
        chip.write(Instant::ZERO, COMMAND, &[CENTIMETRES], world);
        echo(&mut chip, Instant::from_secs(1), world)
    };
    let left = core::f64::consts::FRAC_PI_2;
    assert_eq!(heard(0.0, 0.3, left, &beside), 70);
    assert_eq!(heard(0.0, 0.3, -left, &beside), 0);
    assert_eq!(heard(0.19, 0.0, 0.0, &world(Some(0.2))), 3);
    assert_eq!(heard(0.10, 0.0, 0.0, &world(Some(0.2))), 10);
}

/// 10 cm of noise at 2 m: 500 ranges show it within a seventh.
#[test]
fn noise_is_as_large_as_it_is_set() {
    let world = world(Some(2.0));
    let config = Srf08Config {
        noise_m: 0.1,
        ..Srf08Config::default()
    };
    let mut chip = Srf08::new(config, 1, "test");
    let mut square = |second| {
        chip.write(Instant::from_secs(second), COMMAND, &[CENTIMETRES], &world);
        let cm = echo(&mut chip, Instant::from_secs(second + 1), &world);
        (f64::from(cm) - 200.0).powi(2)
    };
    let deviation = ((0..500).map(&mut square).sum::<f64>() / 500.0).sqrt();
    assert!((8.6..11.4).contains(&deviation), "{deviation} cm");
}

/// ANN mode: the first echo as usual; of the 32 slices of 2048 us only the one with the echo is
/// set. 1 m is 5828 us there and back: the third slice. A plain ranging clears them.
#[test]
fn f17_ann_mode_tells_the_slice_of_the_echo() {
    let world = world(Some(1.0));
    for (command, near) in [(0x53, 39_u16), (0x54, 100), (0x55, 5_828)] {
        let mut chip = chip();
        chip.write(Instant::ZERO, COMMAND, &[command], &world);
        let mut bytes = [0; 34];
        chip.read(Instant::from_secs(1), RANGE, &mut bytes, &world);
        let echo = u16::from_be_bytes([bytes[0], bytes[1]]);
        assert!(
            echo.abs_diff(near) <= near / 50 + 1,
            "{command:02X}: {echo}"
        );
        let slices: Vec<usize> = (0..32).filter(|k| bytes[2 + k] != 0).collect();
        assert_eq!(slices, [2]);
        chip.write(Instant::from_secs(1), COMMAND, &[CENTIMETRES], &world);
        chip.read(Instant::from_secs(2), RANGE, &mut bytes, &world);
        assert_eq!(bytes[2..], [0; 32]);
        assert!(chip.log().0.take().is_empty(), "ANN is a command");
    }
}

/// Addresses are even: the sequence with an odd one changes nothing.
#[test]
fn f17_an_odd_address_is_none() {
    let world = world(Some(1.0));
    let mut chip = chip();
    for byte in [0xA0, 0xAA, 0xA5, 0xE3] {
        chip.write(Instant::ZERO, COMMAND, &[byte], &world);
    }
    assert!(chip.acknowledges(Instant::ZERO, 0xE0) && !chip.acknowledges(Instant::ZERO, 0xE2));
}

/// All chips receive a write to address 0 and none answers a read. A read while the chip ranges
/// finds the bus up; a read from another address gets no answer.
#[test]
fn f17_nobody_answers_a_general_call_and_a_busy_bus_reads_ff() {
    let mut world = world(Some(1.0));
    let mut device = OnBus::new(chip());
    let mut ask = |ms: u64, message: &[u8]| {
        let now = Instant::from_millis(ms);
        device.receive(Port(0), now, message);
        device.poll(Instant::from_millis(ms + 1), &mut world);
        let mut buf = [0; 8];
        let len = device.transmit(Port(0), &mut buf);
        buf[..len].to_vec()
    };
    // A read from the general call address, in a frame: not acknowledged.
    assert_eq!(ask(0, &[0x01, 0x02, 0x01, 0x02]), [0x01, 0x01, 0x00]);
    assert!(ask(2, &[0x00, 0x00, 0x51]).is_empty());
    assert_eq!(ask(10, &[0xE1, 2]), [0xFF, 0xFF]);
    assert!(ask(12, &[0xE3, 2]).is_empty());
    assert!(ask(100, &[0xE0, 0x02]).is_empty());
    let echo = ask(102, &[0xE1, 2]);
    assert!((99..=101).contains(&u16::from_be_bytes([echo[0], echo[1]])));
}

/// Only the first echo and no gain are modelled. Two boards, 0.5 and 2 m ahead: whatever the gain,
/// the first echo is that of the nearer board. The second to the 17th echo, registers 4 to 35, read
/// 0. Register 1 reads the light and not the gain.
#[test]
fn a022_one_echo_is_there_whatever_the_gain() {
    let boards = [0.5, 2.0].map(|x| {
        Fixture::from(Shape::Wall {
            from: Point::new(x, -0.1),
            to: Point::new(x, 0.1),
        })
    });
    let scene = Scene::new(boards, vec![]).unwrap();
    let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap();
    for gain in [0, 16, 31] {
        let mut chip = chip();
        chip.write(Instant::ZERO, GAIN, &[gain], &world);
        chip.write(Instant::ZERO, COMMAND, &[CENTIMETRES], &world);
        let later = Instant::from_secs(1);
        assert!(
            (49..=51).contains(&echo(&mut chip, later, &world)),
            "{gain}"
        );
        let mut others = [0xAA; 32];
        chip.read(later, RANGE + 2, &mut others, &world);
        assert_eq!(others, [0; 32], "{gain}");
        let mut light = [0];
        chip.read(later, GAIN, &mut light, &world);
        assert_eq!(light, [Srf08Config::default().light], "{gain}");
    }
}

/// Without noise: 2.5 m are 98.4 inches and 14,568.8 us there and back, in steps of 4 us. A slice
/// of the ANN mode lasts 2,048 us, so this echo is in the eighth.
#[test]
fn units_and_slices_are_those_of_the_manual() {
    let world = world(Some(2.5));
    let answer = |command: u8| {
        let config = Srf08Config {
            noise_m: 0.0,
            ..Srf08Config::default()
        };
        let mut chip = Srf08::new(config, 1, "test");
        chip.write(Instant::ZERO, COMMAND, &[command], &world);
        let mut bytes = [0; 34];
        chip.read(Instant::from_secs(1), RANGE, &mut bytes, &world);
        let set = (0..32).find(|slice| bytes[2 + slice] != 0);
        (u16::from_be_bytes([bytes[0], bytes[1]]), set)
    };
    let plain = [INCHES, CENTIMETRES, MICROSECONDS].map(answer);
    assert_eq!(plain, [(98, None), (250, None), (14_568, None)]);
    let in_slices = [0x53, 0x54, 0x55].map(answer);
    assert_eq!(
        in_slices,
        [(98, Some(7)), (250, Some(7)), (14_568, Some(7))]
    );
    let slices = [0.0, 2_047.0, 2_049.0, 4_095.0, 4_097.0, 65_535.0].map(whole_slice);
    assert_eq!(slices, [0, 0, 1, 1, 2, 31]);
}

/// A stuck chip shows its last echo; a wrong one adds half a metre unless told otherwise. A chip
/// that is off is neither busy nor there; an odd address counts as the even one below it.
#[test]
fn a_fault_is_one_of_the_chip_alone() {
    let [near, far] = [world(Some(1.0)), world(Some(2.0))];
    let config = Srf08Config {
        noise_m: 0.0,
        address: 0xE3,
        ..Srf08Config::default()
    };
    let mut chip = Srf08::new(config, 1, "test");
    let mut second = 0;
    let mut heard = |chip: &mut Srf08, world: &World| {
        let now = Instant::from_secs(second);
        chip.write(now, COMMAND, &[CENTIMETRES], world);
        second += 1;
        echo(chip, Instant::from_secs(second), world)
    };
    assert_eq!(heard(&mut chip, &near), 100);
    chip.set_fault(Instant::ZERO, "stuck", None, true);
    assert_eq!(heard(&mut chip, &far), 100);
    chip.set_fault(Instant::ZERO, "stuck", None, false);
    assert_eq!(heard(&mut chip, &near), 100);
    chip.set_fault(Instant::ZERO, "wrong", None, true);
    assert_eq!(heard(&mut chip, &near), 150);
    chip.set_fault(Instant::ZERO, "wrong", None, false);
    assert_eq!(heard(&mut chip, &near), 100);
    let at = Instant::from_secs(20);
    chip.write(at, COMMAND, &[CENTIMETRES], &near);
    assert!(chip.is_busy(at, 0xE2) && !chip.is_busy(at, 0xE0));
    assert!(!chip.is_busy(Instant::from_secs(21), 0xE2));
    chip.set_fault(at, "off", None, true);
    assert!(!chip.is_busy(at, 0xE2) && !chip.acknowledges(Instant::from_secs(21), 0));
}

/// A read continues behind the bytes of the last one: the low byte of the echo follows its high
/// byte.
#[test]
fn a_second_read_continues_at_the_next_register() {
    let mut world = world(Some(1.0));
    let mut device = OnBus::new(chip());
    let mut ask = |millis: u64, message: &[u8]| {
        device.receive(Port(0), Instant::from_millis(millis), message);
        device.poll(Instant::from_millis(millis + 1), &mut world);
        let mut answer = [0; 8];
        let len = device.transmit(Port(0), &mut answer);
        answer[..len].to_vec()
    };
    ask(0, &[0xE0, COMMAND, CENTIMETRES]);
    ask(100, &[0xE0, RANGE]);
    assert_eq!(ask(102, &[0xE1, 1]), [0]);
    let low = ask(104, &[0xE1, 1]);
    assert!((99..=101).contains(&low[0]), "{low:?}");
}
