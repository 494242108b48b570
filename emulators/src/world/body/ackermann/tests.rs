//! Behaviour of a car with non-default settings: weak servo, a linkage of its own, wheels that
//! count.

use super::*;

fn car(config: AckermannConfig) -> Ackermann {
    Ackermann::new(config, 1).unwrap()
}

fn prompt() -> AckermannConfig {
    AckermannConfig {
        steering_lag_s: 0.0,
        lag_s: 0.0,
        ..AckermannConfig::default().ideal()
    }
}

/// Steps on to the beginning of step `end`.
fn run(car: &mut Ackermann, from: u64, end: u64) {
    for number in from..end {
        car.begin_step(number);
    }
}

/// The command is 0.2 rad. At rest the wheels turn by all of it, by 4 degrees (0.07 rad) less, or
/// not at all; a rolling car turns them by all of it.
#[test]
fn a_heavy_car_steers_badly_at_rest() {
    for (floor, at_rest) in [
        (Floor::Smooth, 0.2),
        (Floor::Pvc, 0.13),
        (Floor::Carpet, 0.0),
    ] {
        let mut car = car(AckermannConfig { floor, ..prompt() });
        car.actuate(STEERING, Command::Angle(0.2));
        run(&mut car, 0, 500);
        assert!((car.actual(STEERING) - at_rest).abs() < 1e-9, "{floor:?}");
        car.actuate(DRIVE, Command::Speed(0.2));
        run(&mut car, 500, 1_000);
        assert!((car.actual(STEERING) - 0.2).abs() < 1e-9, "{floor:?}");
        // Back to the middle at rest, from the opposite side.
        car.actuate(DRIVE, Command::Speed(0.0));
        run(&mut car, 1_000, 1_100);
        car.actuate(STEERING, Command::Angle(0.0));
        run(&mut car, 1_100, 1_500);
        let short = 0.2 - at_rest;
        assert!((car.actual(STEERING) - short).abs() < 1e-9, "{floor:?}");
    }
}

/// The linkage gives 0.9 of the wanted 0.2 rad and 0.03 rad of trim: 0.21 rad.
#[test]
fn the_linkage_has_a_law_of_its_own() {
    let steering_law = SteeringLaw {
        gain: 0.9,
        trim_rad: 0.03,
        wander_rad: 0.0,
    };
    let mut car = car(AckermannConfig {
        steering_law,
        ..prompt()
    });
    car.actuate(STEERING, Command::Angle(0.2));
    run(&mut car, 0, 500);
    assert!((car.actual(STEERING) - 0.21).abs() < 1e-12);
    assert_eq!(car.command(STEERING), Command::Angle(0.2));
}

/// The angle wanders by 0.02 rad in a metre, so by 0.02 rad times the root of 4 in 4 m. 300 cars
/// show this to 15 %.
#[test]
fn the_law_wanders_with_the_root_of_the_way_and_not_at_rest() {
    let wander = |speed: f64| {
        let mut squares = 0.0;
        for seed in 0..300 {
            let steering_law = SteeringLaw {
                wander_rad: 0.02,
                ..SteeringLaw::default()
            };
            let config = AckermannConfig {
                steering_law,
                ..prompt()
            };
            let mut car = Ackermann::new(config, seed).unwrap();
            car.actuate(DRIVE, Command::Speed(speed));
            run(&mut car, 0, 4_000);
            squares += car.actual(STEERING) * car.actual(STEERING);
        }
        (squares / 300.0).sqrt()
    };
    let rolling = wander(1.0);
    assert!((rolling - 0.04).abs() < 0.006, "{rolling}");
    assert_eq!(wander(0.0), 0.0);
}

/// The command changes from 0.5 m/s to -0.5 m/s. Without braking, the lag of 0.3 s brings the car
/// through 0 after 0.3 ln 2 = 208 ms. With braking first, it reaches 0.03 m/s with a lag of 0.08 s
/// after 0.08 ln(0.5/0.03) = 225 ms. That is later, but the beginning is harder: after 80 ms 1/e of
/// the speed is left, 0.184 m/s instead of 0.266.
#[test]
fn a_reverse_command_brakes_first() {
    let speed = |reversing, millis: u64| {
        let mut car = car(AckermannConfig {
            reversing,
            lag_s: 0.3,
            ..prompt()
        });
        car.actuate(DRIVE, Command::Speed(0.5));
        run(&mut car, 0, 6_000);
        car.actuate(DRIVE, Command::Speed(-0.5));
        run(&mut car, 6_000, 6_000 + millis);
        car.actual(DRIVE)
    };
    assert!((speed(Reversing::AtOnce, 80) - 0.2659).abs() < 0.002);
    assert!((speed(Reversing::BrakesFirst, 80) - 0.1839).abs() < 0.002);
    assert!(speed(Reversing::BrakesFirst, 224) > 0.0);
    assert!((speed(Reversing::BrakesFirst, 3_000) + 0.5).abs() < 0.001);
}

/// In a left turn with a curvature of tan(delta) / 0.258 m = 1/m the left wheel rolls 1 - 0.0775,
/// the right one 1 + 0.0775 of 1 m; 120 counts a turn of 32 mm are 596.83 counts a metre.
#[test]
fn the_outer_wheel_travels_farther() {
    let mut car = car(AckermannConfig {
        wheel_ticks_per_turn: Some(120),
        steering_rate_rad_s: 100.0,
        ..prompt()
    });
    let names: Vec<_> = car.encoders().iter().map(|it| it.name.as_str()).collect();
    assert_eq!(names, ["drive", "rear_left", "rear_right"]);
    car.actuate(STEERING, Command::Angle(libm::atan(0.258)));
    run(&mut car, 0, 100);
    car.actuate(DRIVE, Command::Speed(0.5));
    run(&mut car, 100, 2_101);
    let counts = [0, 1, 2].map(|encoder| car.count(encoder, 0.0));
    assert!((298..=299).contains(&counts[0]), "{counts:?}");
    assert!((550..=551).contains(&counts[1]), "{counts:?}");
    assert!((643..=644).contains(&counts[2]), "{counts:?}");
    assert!((car.axis_speed(1) - 0.5 * 0.9225).abs() < 1e-9);
}

/// Without the option the list is as before.
#[test]
fn a_car_counts_its_shaft_alone_by_default() {
    assert_eq!(car(prompt()).encoders().len(), 1);
}

/// Drawn every 20 steps, 0.02 s, with a deviation of 0.5 by the root of 0.02. It counts by the root
/// of the wheels' speed: 0.3 of it at 0.36 m/s is 0.18 rad/s, forwards and backwards.
#[test]
fn the_heading_has_noise_by_the_root_of_the_speed() {
    let mut noisy = car(AckermannConfig {
        heading_noise_rad: 0.5,
        ..prompt()
    });
    let mut squares = Vec::new();
    for number in 0..20_000 {
        let before = noisy.heading_noise_now;
        noisy.begin_step(number);
        let is_drawn = noisy.heading_noise_now != before;
        assert_eq!(is_drawn, number % 20 == 0, "{number}");
        if is_drawn {
            squares.push(noisy.heading_noise_now.powi(2));
        }
    }
    let square = squares.iter().sum::<f64>() / 1_000.0;
    assert!((square / (0.25 / 0.02) - 1.0).abs() < 0.15, "{square}");
    for speed in [0.36, -0.36] {
        let mut car = car(prompt());
        car.actuate(DRIVE, Command::Speed(speed));
        car.heading_noise_now = 0.3;
        let moved = (1..99).map(|number| {
            car.heading_noise_now = 0.3;
            (car.begin_step(number), car.actual(DRIVE))
        });
        let (velocity, rolled) = moved.last().expect("98 steps");
        let expected = 0.3 * rolled.abs().sqrt();
        assert!(rolled.abs() > 0.05 && (velocity.turn_rad_s - expected).abs() < 1e-9);
    }
}

/// 25 degrees of steering have a tangent of 0.46631: the rear wheels of a car of 0.258 m stand at
/// most twice that by the tangent apart, 1.1066 m.
#[test]
fn a_car_does_not_turn_about_a_point_between_its_wheels() {
    let check = |track_m: f64| {
        let config = AckermannConfig {
            track_m,
            steering_max_rad: 25_f64.to_radians(),
            ..AckermannConfig::default()
        };
        config.check().map_err(|error| error.field)
    };
    let limit_m = 2.0 * 0.258 / 0.466_307_658;
    assert_eq!(
        [limit_m - 1e-4, limit_m + 1e-4].map(check),
        [Ok(()), Err("track_m")]
    );
}
