//! Defects around the base's motors, sensors and battery.

use core::time::Duration;

use emulators::Device;
use emulators::avr_base::profile::Profile;
use emulators::avr_base::{AvrBase, AvrBaseConfig, BatteryConfig, DebugText, StartCause};
use emulators::world::{BodyConfig, Drive, Point, Shape, Wheel};

use super::bench::{Bench, MS, config, floor, read};
use crate::{Observation, Variant};

fn steady(start_mv: f64) -> BatteryConfig {
    BatteryConfig {
        start_mv,
        drop_mv_per_s: 0.0,
    }
}

/// 12000 mV are 2EE0 in hex.
pub(super) fn av_05(variant: Variant) -> Observation {
    let mut bench = Bench::of(AvrBaseConfig {
        battery: steady(12_000.0),
        ..config(variant, Profile::Rcj2015)
    });
    bench.run(100 * MS);
    let data = bench.read(33, 3);
    let decoded = data.first_chunk().map_or(0, |low| u16::from_le_bytes(*low));
    bench
        .seen
        .figure("battery as the master decodes it, mV", decoded);
    bench.judged(decoded == 46)
}

/// Every read that can be torn is torn; once during the drive, the count jumps.
pub(super) fn av_12(variant: Variant) -> Observation {
    let mut bench = Bench::of(AvrBaseConfig {
        encoder_tear: 1.0,
        ..config(variant, Profile::Rcj2015)
    });
    let mut counts = vec![0];
    for _ in 0..150 {
        bench.write(46, &[30, 30, 0]);
        counts.extend(bench.left_ticks());
    }
    bench.seen.wire.clear();
    let largest = counts.windows(2).map(|pair| pair[1] - pair[0]).max();
    let largest = largest.unwrap_or(0);
    bench.seen.figure("largest step in 70 ms, ticks", largest);
    bench.judged(largest > 200)
}

pub(super) fn av_13(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    bench.write(46, &[100]);
    let shown = bench.read(46, 1);
    let obeyed = bench.base.set_points()[0];
    let shown = shown.first().copied().unwrap_or(0);
    bench.seen.figure("register 46", shown);
    bench.seen.figure("set-point in force", obeyed);
    bench.judged(shown == 100 && obeyed == 35)
}

/// Power of the first period after speed 2 with the wheel at rest: 2 from the integral alone, or 4
/// with a proportional part of 1; pulses are 0.84 times the power plus 40.
pub(super) fn av_14(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    bench.write(46, &[2, 0, 0]);
    let pulse = (0..80).find_map(|_| {
        bench.run(MS);
        match bench.world.drive(Wheel::Left) {
            Drive::Power(pulse) if pulse > 0 => Some(pulse),
            Drive::Power(_) | Drive::Brake | Drive::Coast => None,
        }
    });
    let pulse = pulse.unwrap_or(0);
    bench.seen.figure("first pulse of 255", pulse);
    bench.judged(pulse < 43)
}

/// A wheel with four times the encoder lines gives 3100 edges a second: three per poll.
pub(super) fn av_15(variant: Variant) -> Observation {
    let body = BodyConfig {
        ticks_per_turn: 1_440,
        ..BodyConfig::default().ideal()
    };
    let mut bench = Bench::in_world(config(variant, Profile::Rcj2015), floor(vec![], body));
    bench.write(46, &[35, 35, 0]);
    bench.run(900 * MS);
    let counted = i64::from(bench.left_ticks().unwrap_or(0));
    let turned = bench.world.encoder_ticks(Wheel::Left);
    bench.seen.figure("ticks turned", turned);
    bench.seen.figure("ticks counted", counted);
    bench.judged(counted < turned / 2)
}

pub(super) fn av_16(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    bench.base.reset(bench.now, StartCause::Watchdog);
    let asked_at = bench.now;
    bench.send(read(36, 1).as_bytes());
    bench.run(Duration::from_secs(6));
    let late = bench.answered_at.map(|at| at - asked_at);
    let stale = bench.take();
    let told = late.map_or("never".to_owned(), |late| {
        format!("{} ms", late.as_millis())
    });
    bench.seen.figure("answer after", told);
    bench.judged(!stale.is_empty() && late >= Some(Duration::from_secs(4)))
}

/// The option exists only in the fielded firmware.
pub(super) fn av_17(variant: Variant) -> Observation {
    let mut bench = Bench::of(AvrBaseConfig {
        debug_text: DebugText::On,
        ..config(variant, Profile::Rcj2015)
    });
    bench.send(read(36, 1).as_bytes());
    let asked_at = bench.now;
    bench.run(10 * MS);
    let late = bench.answered_at.map_or(Duration::ZERO, |at| at - asked_at);
    bench.take();
    let mut text = [0; 200];
    let len = bench.base.transmit(AvrBase::DEBUG, &mut text);
    bench.seen.figure("reply after, us", late.as_micros());
    bench.seen.figure("bytes of text", len);
    bench.judged(late >= Duration::from_micros(7_150))
}

/// Per cent before the first sample, and after a full battery replaced a flat one.
pub(super) fn av_18(variant: Variant) -> Observation {
    let mut bench = Bench::new(variant);
    let first = bench.read(35, 1);
    for battery in [steady(10_500.0), BatteryConfig::default()] {
        bench.run(200 * MS);
        bench.base.replace_battery(bench.now, battery);
    }
    bench.run(200 * MS);
    let full = bench.read(35, 1);
    let percent = |data: &[u8]| data.first().copied().unwrap_or(0).cast_signed();
    let (first, full) = (percent(&first), percent(&full));
    bench.seen.figure("per cent at first", first);
    bench.seen.figure("per cent with a full battery", full);
    bench.judged(first == 0 && full == 25)
}

/// A wall 30 mm in front of the long-range sensor.
pub(super) fn av_19(variant: Variant) -> Observation {
    let wall = Shape::Wall {
        from: Point::new(0.18, -1.0),
        to: Point::new(0.18, 1.0),
    };
    let world = floor(vec![wall], BodyConfig::default());
    let mut bench = Bench::in_world(config(variant, Profile::Rcj2015), world);
    bench.run(300 * MS);
    let data = bench.read(9, 2);
    let distance = data.first_chunk().map_or(0, |two| i16::from_le_bytes(*two));
    bench.seen.figure("distance ahead, mm", distance);
    bench.judged(distance < 0)
}

pub(super) fn h_av_1(variant: Variant) -> Observation {
    let mut bench = Bench::of(config(variant, Profile::Rcj2014));
    bench.write(46, &[20, 20, 0]);
    bench.run(Duration::from_secs(5));
    let moves = bench.moving("wheels after 5 s of silence");
    bench.judged(moves)
}

pub(super) fn h_av_2(variant: Variant) -> Observation {
    let mut bench = Bench::of(config(variant, Profile::Rcj2014));
    bench.write(46, &[20, 0xEC, 0]);
    bench.run(500 * MS);
    let right = bench.base.set_points()[1];
    bench.seen.figure("right set-point in force", right);
    let ahead = bench.world.wheel_speed(Wheel::Right) > 0.0;
    let turns = if ahead { "ahead" } else { "back" };
    bench.seen.figure("right wheel turns", turns);
    bench.judged(right == 35 && ahead)
}
