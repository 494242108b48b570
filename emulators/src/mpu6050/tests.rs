//! The register map, and a car that turns.

use super::*;
use crate::world::{Ackermann, AckermannConfig, Command, Fixture, Pose, Scene};

fn ideal() -> Mpu6050Config {
    Mpu6050Config {
        bias_dps: [0.0; 3],
        bias_walk_dps: 0.0,
        gyro_noise_dps: 0.0,
        accel_noise_m_s2: 0.0,
        temperature_c: 36.53,
    }
}

fn world() -> World {
    let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
    let config = AckermannConfig::default().ideal();
    let body = Box::new(Ackermann::new(config, 1).unwrap());
    World::with_chassis(scene, body, Pose::default()).unwrap()
}

fn awake(config: Mpu6050Config, world: &World) -> Mpu6050 {
    let mut chip = Mpu6050::new(config, 1, "test");
    chip.write(world.now(), register::POWER, &[0], world);
    chip
}

fn word(chip: &mut Mpu6050, register: u8, world: &World) -> i16 {
    let mut bytes = [0; 2];
    chip.read(world.now(), register, &mut bytes, world);
    i16::from_be_bytes(bytes)
}

/// Register map: name 68, asleep after power-up, and then no data; ranges read back.
#[test]
fn the_chip_sleeps_until_it_is_woken() {
    let world = world();
    let mut chip = Mpu6050::new(ideal(), 1, "test");
    let read = |chip: &mut Mpu6050, register| {
        let mut byte = [0];
        chip.read(Instant::ZERO, register, &mut byte, &world);
        byte[0]
    };
    assert!(chip.acknowledges(Instant::ZERO, 0xD0) && !chip.acknowledges(Instant::ZERO, 0xD2));
    assert_eq!(read(&mut chip, register::WHO_AM_I), 0x68);
    assert_eq!(read(&mut chip, register::POWER), 0x40);
    assert_eq!(word(&mut chip, 0x3F, &world), 0);
    chip.write(Instant::ZERO, register::POWER, &[0], &world);
    assert_eq!(word(&mut chip, 0x3F, &world), 16_384, "1 g up");
    chip.write(Instant::ZERO, register::GYRO_CONFIG, &[0x18, 0x10], &world);
    assert_eq!(read(&mut chip, register::GYRO_CONFIG), 0x18);
    assert_eq!(read(&mut chip, register::ACCEL_CONFIG), 0x10);
    assert_eq!(word(&mut chip, 0x3F, &world), 4_096);
    assert_eq!(word(&mut chip, 0x41, &world), 0, "36.53 degrees");
    chip.write(Instant::ZERO, register::POWER, &[0x80], &world);
    assert_eq!(read(&mut chip, register::POWER), 0x40);
    assert_eq!(read(&mut chip, register::GYRO_CONFIG), 0);
}

/// A car at 0.6 m/s with its wheels at 0.3 rad and a wheelbase of 0.258 m turns at 0.7194 rad/s,
/// 41.218 degrees a second: 676 counts in the range of 2000 degrees a second, 5400 in that of 250.
/// The curve pulls with 0.4316 m/s², 721 counts in the range of 2 g.
#[test]
fn a_curve_shows_in_all_ranges() {
    let mut world = world();
    world.actuate("drive", Command::Speed(0.6)).unwrap();
    world.actuate("steering", Command::Angle(0.3)).unwrap();
    world.advance(Instant::from_secs(6));
    let mut chip = awake(ideal(), &world);
    assert!((5_395..=5_405).contains(&word(&mut chip, 0x47, &world)));
    assert!((715..=727).contains(&word(&mut chip, 0x3D, &world)));
    for (bits, counts) in [(0x08, 2_700), (0x10, 1_352), (0x18, 676)] {
        chip.write(world.now(), register::GYRO_CONFIG, &[bits], &world);
        let found = word(&mut chip, 0x47, &world);
        assert!((found - counts).abs() <= 3, "{bits:02X}: {found}");
    }
    assert_eq!(word(&mut chip, register::GYRO, &world), 0);
}

/// A bias of 0.5 degrees a second is 8 counts in the range of 2000; one of 3000 saturates the word.
#[test]
fn a_word_saturates() {
    let world = world();
    let config = |bias| Mpu6050Config {
        bias_dps: [0.0, 0.0, bias],
        ..ideal()
    };
    let mut chip = awake(config(0.5), &world);
    chip.write(world.now(), register::GYRO_CONFIG, &[0x18], &world);
    assert_eq!(word(&mut chip, 0x47, &world), 8);
    let mut chip = awake(config(3_000.0), &world);
    assert_eq!(word(&mut chip, 0x47, &world), i16::MAX);
}

/// The bias of 200 chips deviates by 0.02 degrees a second after 1 s and by 0.2 after 100 s; a turn
/// to the left and one to the right end the walk.
#[test]
fn the_bias_walks_and_begins_anew_when_the_turn_changes() {
    let mut squares = 0.0;
    for seed in 0..200 {
        let config = Mpu6050Config {
            bias_walk_dps: 0.02,
            ..ideal()
        };
        let mut chip = Mpu6050::new(config, seed, "test");
        for second in 1..=100 {
            chip.walk(Instant::from_secs(second), 0.0);
        }
        squares += chip.walked[2] * chip.walked[2];
        chip.walk(Instant::from_secs(101), 10.0);
        assert_eq!(chip.walked, [0.0; 3]);
        chip.walk(Instant::from_secs(102), 10.0);
        assert!(chip.walked[2] != 0.0, "the same way: it goes on");
        chip.walk(Instant::from_secs(103), -10.0);
        assert_eq!(chip.walked, [0.0; 3]);
    }
    let walked = (squares / 200.0_f64).sqrt();
    assert!((walked - 0.2).abs() < 0.03, "{walked}");
}

#[test]
fn faults_show_on_the_bus() {
    let world = world();
    let mut chip = awake(Mpu6050Config::default(), &world);
    let before = word(&mut chip, 0x47, &world);
    chip.set_fault(world.now(), "stuck", None, true);
    for _ in 0..20 {
        assert_eq!(word(&mut chip, 0x47, &world), before);
    }
    chip.set_fault(world.now(), "stuck", None, false);
    assert!((0..20).any(|_| word(&mut chip, 0x47, &world) != before));
    chip.set_fault(world.now(), "wrong", None, true);
    let mut name = [0];
    chip.read(world.now(), register::WHO_AM_I, &mut name, &world);
    assert_ne!(name, [IDENTITY]);
    chip.set_fault(world.now(), "restart", None, true);
    assert_eq!(word(&mut chip, 0x47, &world), 0, "asleep");
    chip.set_fault(world.now(), "off", None, true);
    assert!(!chip.acknowledges(world.now(), ADDRESS));
}

/// A temperature of 28 degrees is (28 - 36.53) * 340 = -2900.2 counts. With 131 counts for a degree
/// a second, the biases of the three axes are -144.1, 78.6 and 26.2 counts.
#[test]
fn temperature_and_the_bias_of_each_axis_are_shown() {
    let world = world();
    let config = Mpu6050Config {
        temperature_c: 28.0,
        bias_dps: [-1.1, 0.6, 0.2],
        ..ideal()
    };
    let mut chip = awake(config, &world);
    let words = [0x41, 0x43, 0x45, 0x47].map(|register| word(&mut chip, register, &world));
    assert_eq!(words, [-2_900, -144, 79, 26]);
}

/// Noise of 0.05 degrees a second is 6.55 counts, noise of 0.04 m/s² is 66.8. 2000 samples show
/// them within a tenth.
#[test]
fn noise_is_as_large_as_it_is_set() {
    let world = world();
    let mut chip = awake(
        Mpu6050Config {
            gyro_noise_dps: 0.05,
            accel_noise_m_s2: 0.04,
            ..ideal()
        },
        &world,
    );
    for (register, expected) in [(0x47, 6.55), (0x3B, 66.8)] {
        let mut square = || f64::from(word(&mut chip, register, &world)).powi(2);
        let deviation = ((0..2_000).map(|_| square()).sum::<f64>() / 2_000.0).sqrt();
        assert!(
            (deviation / expected - 1.0).abs() < 0.1,
            "{register:02X}: {deviation}"
        );
    }
}

/// At 2 degrees a second and below the body counts as not turning.
#[test]
fn standing_still_between_two_turns_the_same_way_leaves_the_walk() {
    let config = Mpu6050Config {
        bias_walk_dps: 0.02,
        ..ideal()
    };
    let mut chip = Mpu6050::new(config, 1, "test");
    let rates = [10.0, 10.0, 0.0, -2.0, 10.0, -10.0, 2.0, -10.0];
    let anew = [true, false, false, false, false, true, false, false];
    for (second, (rate, anew)) in (1..).zip(rates.into_iter().zip(anew)) {
        chip.walk(Instant::from_secs(second), rate);
        assert_eq!(chip.walked == [0.0; 3], anew, "second {second}");
    }
}

/// A restart is finished at once: its end has no effect.
#[test]
fn settings_are_read_back_until_a_restart_and_not_lost_by_its_end() {
    let world = world();
    let mut chip = awake(ideal(), &world);
    let filter = |chip: &mut Mpu6050| word(chip, 0x1A, &world).to_be_bytes()[0];
    chip.write(world.now(), 0x1A, &[0xC5], &world);
    assert_eq!(filter(&mut chip), 0xC5);
    chip.set_fault(world.now(), "restart", None, false);
    assert_eq!(filter(&mut chip), 0xC5);
    chip.set_fault(world.now(), "restart", None, true);
    assert_eq!(filter(&mut chip), 0);
    assert_eq!(chip.known_faults(), ["off", "restart", "stuck", "wrong"]);
}

/// A bias of 2 degrees a second, and 1 more from its walk: 3 times 131 counts.
#[test]
fn what_has_walked_adds_to_the_bias() {
    let world = world();
    let config = Mpu6050Config {
        bias_dps: [2.0, 0.0, -2.0],
        ..ideal()
    };
    let mut chip = awake(config, &world);
    chip.walked = [1.0; 3];
    let rates = [0x43, 0x45, 0x47].map(|register| word(&mut chip, register, &world));
    assert_eq!(rates, [393, 131, -131]);
}

/// 0.02 degrees a second times the root of the time times numbers of the chip's own stream, axis
/// by axis: 1 s, then 4 s.
#[test]
fn the_bias_walks_by_the_root_of_the_time() {
    let config = Mpu6050Config {
        bias_walk_dps: 0.02,
        ..ideal()
    };
    let mut chip = Mpu6050::new(config, 3, "walk");
    let mut drawn = Rng::stream(3, "walk");
    let first = [(); 3].map(|()| drawn.gauss());
    let second = [(); 3].map(|()| drawn.gauss());
    chip.walk(Instant::from_secs(1), 0.0);
    chip.walk(Instant::from_secs(5), 0.0);
    for axis in 0..3 {
        let expected = 0.02 * first[axis] + 0.04 * second[axis];
        assert!((chip.walked[axis] - expected).abs() < 1e-12);
    }
}

/// Register map: every register that is not the chip's own keeps the written value. The bits that
/// reset something clear themselves, and registers of the chip do not change.
#[test]
fn f17_registers_keep_what_is_written() {
    let world = world();
    let mut chip = awake(ideal(), &world);
    let read = |chip: &mut Mpu6050, register| {
        let mut byte = [0];
        chip.read(world.now(), register, &mut byte, &world);
        byte[0]
    };
    let kept = (0x0D..=0x39).chain(0x63..=0x67).chain([0x69, 0x6C]);
    for register in kept {
        for value in [0xA5, 0x5A, 0xFF, 0x00] {
            chip.write(world.now(), register, &[value], &world);
            assert_eq!(read(&mut chip, register), value, "{register:02X}");
        }
    }
    chip.write(world.now(), register::USER_CONTROL, &[0x47], &world);
    assert_eq!(read(&mut chip, register::USER_CONTROL), 0x40);
    for register in [0x3B, 0x48, 0x72, register::WHO_AM_I, 0x7F] {
        let before = read(&mut chip, register);
        chip.write(world.now(), register, &[!before], &world);
        assert_eq!(read(&mut chip, register), before, "{register:02X}");
    }
    chip.write(world.now(), register::POWER, &[0x80], &world);
    assert_eq!(
        [0x19, 0x23, 0x6C].map(|register| read(&mut chip, register)),
        [0; 3]
    );
}

/// 1 kHz with a filter, divided by 8: a sample each 8 ms. Reading the status clears it; asleep
/// nothing is ready.
#[test]
fn f17_a_sample_is_ready_at_the_sample_rate() {
    let world = world();
    let mut chip = Mpu6050::new(ideal(), 1, "test");
    let status = |chip: &mut Mpu6050, ms| {
        let mut byte = [0];
        chip.read(
            Instant::from_millis(ms),
            register::INT_STATUS,
            &mut byte,
            &world,
        );
        byte[0]
    };
    assert_eq!(status(&mut chip, 100), 0);
    chip.write(
        Instant::from_millis(100),
        register::DIVIDER,
        &[7, 3],
        &world,
    );
    chip.write(Instant::from_millis(100), register::POWER, &[0], &world);
    let found = [107, 108, 109, 115, 116, 200, 201].map(|ms| status(&mut chip, ms));
    assert_eq!(found, [0, 1, 0, 0, 1, 1, 0]);
}

/// Accelerations and the turn rate about z, 8 bytes a sample, 100 samples a second: 25 of them in
/// 250 ms. They come out in the order of the registers, and the register behind the FIFO is not
/// read. Of more than 1024 bytes the oldest are lost, and the status shows it.
#[test]
fn f17_the_fifo_holds_samples_until_they_are_read() {
    let world = world();
    let mut chip = awake(ideal(), &world);
    let at = Instant::from_millis;
    chip.write(at(0), register::DIVIDER, &[9, 1], &world);
    chip.write(at(0), register::FIFO_ENABLE, &[0x18], &world);
    chip.write(
        at(0),
        register::USER_CONTROL,
        &[FIFO_ON | FIFO_RESET],
        &world,
    );
    let count = |chip: &mut Mpu6050, ms| {
        let mut bytes = [0; 2];
        chip.read(at(ms), register::FIFO_COUNT, &mut bytes, &world);
        u16::from_be_bytes(bytes)
    };
    assert_eq!(count(&mut chip, 250), 200);
    let mut sample = [0; 16];
    chip.read(at(250), register::FIFO, &mut sample, &world);
    assert_eq!(
        sample,
        [0, 0, 0, 0, 0x40, 0, 0, 0, 0, 0, 0, 0, 0x40, 0, 0, 0]
    );
    assert_eq!(chip.next_register(register::FIFO, 16), register::FIFO);
    assert_eq!(count(&mut chip, 250), 184);
    assert_eq!(count(&mut chip, 5_000), 1_024);
    let mut status = [0];
    chip.read(at(5_000), register::INT_STATUS, &mut status, &world);
    assert_eq!(status, [OVERFLOW | READY]);
    chip.write(at(5_000), register::USER_CONTROL, &[FIFO_RESET], &world);
    assert_eq!(count(&mut chip, 6_000), 0);
}

/// Register map: bits 0 to 2 select the filter. Filters 1 to 6 give 1 kHz, 0 and 7 give 8 kHz, each
/// divided by the divider plus one. Bits 3 to 5 belong to the external pin.
#[test]
fn the_filter_and_the_divider_give_the_rate() {
    let world = world();
    let mut chip = awake(ideal(), &world);
    for (filter, divider, micros) in [
        (0x00, 7, 1_000),
        (0x01, 0, 1_000),
        (0x06, 9, 10_000),
        (0x07, 0, 125),
        (0x39, 0, 1_000),
        (0x38, 0, 125),
    ] {
        chip.write(world.now(), register::FILTER, &[filter], &world);
        chip.write(world.now(), register::DIVIDER, &[divider], &world);
        let period = chip.sample_period();
        assert_eq!(period, Duration::from_micros(micros), "{filter:#x}");
    }
}

/// A sample each 10 ms. Temperature and the turn rates about x and y are 6 bytes, in the order of
/// the registers: 28 degrees are F4AC, 1 and 2 degrees a second 0083 and 0106. An empty FIFO
/// continues with its last byte.
#[test]
fn the_fifo_takes_the_sources_that_are_set() {
    let world = world();
    let config = Mpu6050Config {
        temperature_c: 28.0,
        bias_dps: [1.0, 2.0, 3.0],
        ..ideal()
    };
    let mut chip = awake(config, &world);
    let at = Instant::from_millis;
    chip.write(at(0), register::DIVIDER, &[9, 1], &world);
    chip.write(at(0), register::FIFO_ENABLE, &[0xE0], &world);
    chip.write(at(0), register::USER_CONTROL, &[FIFO_ON], &world);
    let mut bytes = [0; 10];
    // The two bytes of the count, then the FIFO itself.
    chip.read(at(10), register::FIFO_COUNT, &mut bytes, &world);
    assert_eq!(
        bytes,
        [0, 6, 0xF4, 0xAC, 0x00, 0x83, 0x01, 0x06, 0x06, 0x06]
    );
    chip.write(at(10), register::FIFO_ENABLE, &[0x10], &world);
    let mut bytes = [0; 4];
    chip.read(at(20), register::FIFO_COUNT, &mut bytes, &world);
    // The word is a turn rate of 3 degrees a second.
    assert_eq!(bytes, [0, 2, 0x01, 0x89]);
}

/// 128 samples of 8 bytes fill the FIFO of 1024 bytes. The next one drops the oldest.
#[test]
fn a_full_fifo_has_not_overflowed() {
    let world = world();
    let mut chip = awake(ideal(), &world);
    let at = Instant::from_millis;
    chip.write(at(0), register::DIVIDER, &[9, 1], &world);
    chip.write(at(0), register::FIFO_ENABLE, &[0x18], &world);
    chip.write(at(0), register::USER_CONTROL, &[FIFO_ON], &world);
    let mut look = |ms| {
        let (mut status, mut count) = ([0], [0; 2]);
        chip.read(at(ms), register::INT_STATUS, &mut status, &world);
        chip.read(at(ms), register::FIFO_COUNT, &mut count, &world);
        (status[0], u16::from_be_bytes(count))
    };
    assert_eq!(look(10), (READY, 8));
    assert_eq!(look(1_280), (READY, 1_024));
    assert_eq!(look(1_290), (OVERFLOW | READY, 1_024));
}

/// The register that resets signal paths reads 0. Reads stop at the FIFO from below only.
#[test]
fn a_read_stays_at_the_fifo() {
    let world = world();
    let mut chip = awake(ideal(), &world);
    chip.write(world.now(), 0x68, &[0x07], &world);
    assert_eq!(word(&mut chip, 0x67, &world), 0);
    let next = [(0x72, 1), (0x73, 1), (0x73, 2), (0x10, 0x70), (0x75, 1)];
    let next = next.map(|(register, count)| chip.next_register(register, count));
    assert_eq!(next, [0x73, 0x74, 0x74, 0x74, 0x76]);
}

/// While the sensor is stuck no sample is ready, and none is made up for the time.
#[test]
fn a_stuck_chip_has_no_samples_to_make_up_for() {
    let world = world();
    let mut chip = awake(ideal(), &world);
    let at = Instant::from_millis;
    chip.write(at(0), register::DIVIDER, &[9, 1], &world);
    let status = |chip: &mut Mpu6050, ms| {
        let mut byte = [0];
        chip.read(at(ms), register::INT_STATUS, &mut byte, &world);
        byte[0]
    };
    chip.set_fault(at(0), "stuck", None, true);
    assert_eq!(status(&mut chip, 105), 0);
    chip.set_fault(at(105), "stuck", None, false);
    assert_eq!([110, 115].map(|ms| status(&mut chip, ms)), [0, READY]);
}
