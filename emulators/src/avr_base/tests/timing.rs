//! Times of events: windows measured on field firmware b77a6df, over the phases of its divider.

use super::*;
use crate::world::Wheel;

const SECOND: Duration = Duration::from_secs(1);

/// `count` phases spread evenly over one count of the divider.
fn phases(count: u32) -> impl Iterator<Item = Duration> {
    (0..count).map(move |n| DIVIDER * n / count)
}

/// Measured: 10.0 to 10.2 us from byte to byte.
#[test]
fn long_replies_take_10_us_a_byte() {
    let total = |bytes: u64| {
        let mut bench = Bench::new(in_phase(Profile::Rcj2015));
        bench.send(Frame::read(0, u8::try_from(bytes).unwrap(), bench.order()).as_bytes());
        let end = bench.now;
        bench.run(4 * MS);
        let first = bench.sent[0].0 - end;
        let last = bench.sent[bench.sent.len() - 1].0 - end;
        (last - first).as_micros()
    };
    for (bytes, pitches) in [(3, 7), (10, 14), (53, 57)] {
        let took = total(bytes);
        assert!((pitches * 10..=pitches * 51 / 5).contains(&took), "{took}");
    }
}

/// Measured: 20 second requests each were sent 0, 50, 100 and 150 us after the end of a first one.
/// The base answered 0, 12, 17 and about 20 of them.
#[test]
fn a_second_request_is_lost_while_the_first_is_worked_on() {
    let answered = |gap_us: u64| {
        let mut bench = Bench::new(in_phase(Profile::Rcj2015));
        (0..200)
            .filter(|n| {
                bench.run(PAUSE + Duration::from_micros(37 * n));
                bench.sent.clear();
                bench.send(&hex("AB 24 01 00 D0"));
                bench.run(Duration::from_micros(gap_us));
                bench.send(&hex("AB 25 01 00 D1"));
                bench.run(4 * MS);
                bench.take().len() == 12
            })
            .count()
    };
    assert_eq!(answered(0), 0);
    assert!((100..150).contains(&answered(50)), "{}", answered(50));
    assert!((150..190).contains(&answered(100)), "{}", answered(100));
    assert!((190..=200).contains(&answered(150)), "{}", answered(150));
}

/// From the end of a write to the moment at which the watchdog clears the set-points.
fn motor_time_out(config: AvrBaseConfig) -> Duration {
    let mut bench = Bench::new(config);
    bench.send(&hex("AB 2E 83 14 EC 00 02 5C"));
    let end = bench.now;
    bench.run(2 * SECOND);
    assert_eq!([46, 47].map(|r| bench.base.register(r)), [0, 0]);
    let notes = bench.notes();
    let fired = notes.iter().find(|note| note.1 == "watchdog");
    fired.expect("the watchdog fires").0 - end
}

/// Measured over 24 phases: 980.6 to 1006.2 ms. The least time possible with 40 counts is 978.9 ms.
#[test]
fn motors_time_out_after_978_9_to_1006_2_ms() {
    let times: Vec<_> = phases(24)
        .map(|phase| motor_time_out(with_phase(Profile::Rcj2015, phase)).as_micros())
        .collect();
    let (least, most) = (times.iter().min(), times.iter().max());
    assert!(
        least >= Some(&978_900) && most <= Some(&1_006_200),
        "{times:?}"
    );
    // The times spread over a whole period of the divider.
    assert!(
        most > least.map(|least| least + 22_500).as_ref(),
        "{times:?}"
    );
}

/// In the fielded builds only writes that begin at 46, 47 or 48 keep the motors alive: neither
/// reads nor other writes do.
#[test]
fn only_drive_writes_keep_the_fielded_motors_alive() {
    let alive_by = |request: Frame| {
        let mut bench = Bench::new(in_phase(Profile::Rcj2015));
        bench.write(46, &[20, 20, 0]);
        bench.run(500 * MS);
        bench.ask(request.as_bytes());
        bench.run(600 * MS);
        bench.base.set_points() == [20, 20]
    };
    let order = ChecksumOrder::HighFirst;
    let writes = [46, 47, 48].map(|register| Frame::write(register, &[], order));
    assert_eq!(writes.map(alive_by), [true; 3]);
    assert!(!alive_by(Frame::write(49, &[0], order)));
    assert!(!alive_by(Frame::write(45, &[], order)));
    assert!(!alive_by(Frame::read(46, 3, order)));
}

/// Three seconds (120 counts) without a frame make the light blink green; any frame, also a bad
/// one, ends that.
#[test]
fn the_light_shows_that_nobody_speaks() {
    let mut bench = Bench::new(in_phase(Profile::Rcj2015));
    bench.read(36, 1);
    bench.run(Duration::from_millis(2_950));
    assert!(matches!(bench.base.led(), Led::Heartbeat { .. }));
    bench.run(100 * MS);
    assert_eq!(bench.base.led(), Led::Blink { hue: 85 });
    bench.ask(&hex("AB 24 01 00 00"));
    assert!(matches!(bench.base.led(), Led::Heartbeat { .. }));
}

/// The measurement's other half: the pulse ends at the next run of the regulator.
#[test]
fn the_drive_ends_within_a_period_of_the_regulator_after_the_time_out() {
    let mut bench = Bench::new(in_phase(Profile::Rcj2015));
    bench.write(46, &[20, 20, 0]);
    bench.run(2 * SECOND);
    let notes = bench.notes();
    let names: Vec<_> = notes.iter().map(|note| note.1).collect();
    assert_eq!(names, ["motors-on", "watchdog", "motors-stopped"]);
    assert!(notes[2].0 - notes[1].0 <= REGULATOR);
    assert_eq!(bench.world.drive(Wheel::Left), Drive::Brake);
    assert!(!bench.world.is_moving());
}

/// The document says "a short time"; ours is one second after the last valid frame of any kind.
#[test]
fn the_documented_base_stops_a_second_after_the_last_frame() {
    let mut bench = Bench::new(in_phase(Profile::Document));
    bench.send(Frame::write(46, &[20, 20, 0], bench.order()).as_bytes());
    bench.run(Duration::from_millis(700));
    bench.send(Frame::read(36, 10, bench.order()).as_bytes());
    let end = bench.now;
    bench.run(SECOND - Duration::from_micros(1));
    assert_ne!(bench.world.drive(Wheel::Left), Drive::Brake);
    bench.run(Duration::from_micros(1));
    assert_eq!(bench.world.drive(Wheel::Left), Drive::Brake);
    assert_eq!(bench.notes().last().map(|note| note.0), Some(end + SECOND));
}

/// Number of good frames, of 16, that are accepted `gap` after a fragment of two bytes. Each frame
/// has another phase.
fn accepted_after_fragment(profile: Profile, gap: Duration) -> usize {
    phases(16)
        .filter(|&phase| {
            let mut bench = Bench::new(with_phase(profile, phase));
            bench.send(&hex("AB 24"));
            bench.run(gap);
            bench.send(Frame::read(36, 1, bench.order()).as_bytes());
            bench.run(MS);
            bench.take().len() == 6
        })
        .count()
}

/// Measured: 0, 3, 8, 12 and 14 of 16 frames are accepted after gaps of 1, 5, 13, 19 and 23 ms. In
/// the end all 16 are: a count comes within 25.1 ms, and the analog task holds the main loop for
/// 1.06 ms more.
#[test]
fn a_fragment_is_forgotten_in_proportion_to_the_gap() {
    let accepted = [1, 5, 13, 19, 23].map(|ms| accepted_after_fragment(Profile::Rcj2015, ms * MS));
    let off = accepted
        .iter()
        .zip([0, 3, 8, 12, 14])
        .map(|(&count, measured)| count.abs_diff(measured));
    assert!(off.max() <= Some(1), "{accepted:?}");
    let all = accepted_after_fragment(Profile::Rcj2015, Duration::from_micros(26_300));
    assert_eq!(all, 16);
}

/// Measured: a gap of 5, 10 and 20 ms inside a frame loses 15, 40 and 85 percent.
#[test]
fn a_gap_inside_a_frame_loses_it_in_proportion() {
    let lost = |ms: u32| {
        let lost = phases(100).filter(|&phase| {
            let mut bench = Bench::new(with_phase(Profile::Rcj2015, phase));
            bench.send(&hex("AB 24"));
            bench.run(ms * MS);
            bench.send(&hex("01 00 D0"));
            bench.run(MS);
            bench.take().is_empty()
        });
        lost.count()
    };
    let [five, ten, twenty] = [5, 10, 20].map(lost);
    assert!((15..=25).contains(&five), "{five}");
    assert!((35..=45).contains(&ten), "{ten}");
    assert!((75..=85).contains(&twenty), "{twenty}");
}

/// The idle gap of the documented base is a promise: 1.9 ms never lose a frame, 2.1 ms always end
/// a fragment.
#[test]
fn the_documented_idle_gap_does_not_depend_on_the_phase() {
    let profile = Profile::Document;
    assert_eq!(accepted_after_fragment(profile, 2 * MS + MS / 10), 16);
    let mut bench = Bench::new(in_phase(profile));
    for byte in hex("AB 24 01 D0 00") {
        bench.run(2 * MS - MS / 10);
        bench.send(&[byte]);
    }
    bench.run(MS);
    assert_eq!(bench.take().len(), 6);
}

/// Each infrared value is refreshed every 150.6 ms, the battery every 50.2 ms; its voltage follows
/// from the main loop's turn behind the count of the divider.
#[test]
fn analog_values_come_in_blocks() {
    let mut bench = Bench::new(in_phase(Profile::Rcj2015));
    let front_left = |bench: &Bench| bench.base.register(21);
    let front_right = |bench: &Bench| bench.base.register(31);
    assert_eq!((bench.base.register(33), front_left(&bench)), (0, 0));
    bench.run(Duration::from_micros(50_400) - 10 * MS);
    assert_ne!(bench.base.register(33), 0);
    assert_eq!((front_left(&bench), front_right(&bench)), (200, 0));
    bench.run(Duration::from_micros(50_200));
    assert_eq!(front_right(&bench), 200);
}

/// The button holds the motors for 120 counts of the divider (3.01 s) after its release; the
/// speeds in the registers stay and come back if the master kept writing them.
#[test]
fn the_stop_button_holds_the_motors_for_three_seconds() {
    let mut bench = Bench::new(in_phase(Profile::Rcj2015));
    let drive = |bench: &mut Bench, seconds: u32| {
        for _ in 0..seconds * 5 {
            bench.write(46, &[20, 20, 0]);
            bench.run(166 * MS);
        }
    };
    drive(&mut bench, 1);
    assert!(bench.world.is_moving());
    bench.base.press_stop(bench.now);
    drive(&mut bench, 1);
    assert!(!bench.world.is_moving());
    assert_eq!(bench.base.led(), Led::Blink { hue: 30 });
    bench.base.release_stop(bench.now);
    drive(&mut bench, 2);
    assert!(!bench.world.is_moving());
    drive(&mut bench, 2);
    assert!(bench.world.is_moving());
    let stopped = bench.notes().into_iter().find(|n| n.1 == "motors-stopped");
    assert_eq!(stopped.map(|note| note.2), Some("stop-button".into()));
}

/// A set-point of 20 ticks per 40.16 ms is 20 * 0.45379 mm / 40.16 ms = 226 mm/s.
#[test]
fn the_regulator_holds_the_speed_of_its_set_point() {
    for profile in [Profile::Document, Profile::Rcj2015] {
        let mut bench = Bench::new(in_phase(profile));
        for _ in 0..10 {
            bench.write(46, &[20, 20, 0]);
            bench.run(200 * MS);
        }
        let before = bench.world.encoder_ticks(Wheel::Left);
        bench.run(Duration::from_micros(803_200));
        let ticks = bench.world.encoder_ticks(Wheel::Left) - before;
        assert!(
            (ticks - 400).abs() <= 12,
            "{profile}: {ticks} in 20 periods"
        );
        let counts = bench.read(36, 4);
        let counted = i64::from(i32::from_le_bytes(counts.try_into().unwrap()));
        // The wheel turns on for the few milliseconds that the bench waits for the reply.
        let behind = bench.world.encoder_ticks(Wheel::Left) - counted;
        assert!((0..=2).contains(&behind), "{profile}: {behind}");
    }
}

/// Stand-by lets the motors run out; the regulator continues and the registers stay.
#[test]
fn stand_by_lets_the_motors_go() {
    let mut bench = Bench::new(in_phase(Profile::Document));
    bench.write(46, &[20, 20, 0]);
    bench.run(300 * MS);
    bench.write(48, &[1]);
    bench.run(50 * MS);
    assert_eq!(bench.world.drive(Wheel::Left), Drive::Coast);
    assert!(!bench.base.motors_enabled());
    assert_eq!(bench.read(46, 3), [20, 20, 1]);
}

/// An additional poll at any time changes nothing.
#[test]
fn polling_more_often_changes_nothing() {
    let run = |step: Duration| {
        let mut bench = Bench::new(with_phase(Profile::Rcj2015, 3 * MS));
        bench.write(46, &[20, 10, 0]);
        let end = bench.now + SECOND + SECOND;
        while bench.now < end {
            bench.run(step);
        }
        let registers: Vec<_> = (0..53).map(|r| bench.base.register(r)).collect();
        (registers, bench.world.pose(), bench.base.take_events())
    };
    assert_eq!(run(SECOND), run(Duration::from_micros(400)));
}

/// A rig in real time may poll late. Five periods at once must not look like five times the speed,
/// or the regulator would jerk the robot.
#[test]
fn a_late_poll_does_not_upset_the_regulator() {
    let mut bench = Bench::new(in_phase(Profile::Document));
    for _ in 0..10 {
        bench.write(46, &[20, 20, 0]);
        bench.run(200 * MS);
    }
    bench.write(46, &[20, 20, 0]);
    bench.now += 200 * MS;
    bench.poll();
    let speed = bench.base.register(44);
    assert!((18..=22).contains(&speed), "{speed}");
}

/// A processor that restarts loses its state: counts begin at 0, speeds are 0, the driver lets go,
/// and no answer comes before it is up.
#[test]
fn a_reset_forgets_everything() {
    for profile in Profile::ALL {
        let mut bench = Bench::new(in_phase(profile));
        bench.write(46, &[20, 20, 0]);
        bench.run(500 * MS);
        bench.base.reset(bench.now, StartCause::PowerOn);
        bench.run(MS);
        assert_eq!(bench.world.drive(Wheel::Left), Drive::Coast);
        bench.run(PAUSE);
        let reply = bench.read(36, 10);
        assert!(
            reply[0] < 60 && reply[1..4] == [0; 3],
            "{profile}: {reply:?}"
        );
        assert_eq!(bench.read(46, 3), [0, 0, 0]);
        bench.run(500 * MS);
        assert!(!bench.world.is_moving());
        let notes: Vec<_> = bench.notes().into_iter().map(|note| note.1).collect();
        assert_eq!(notes, ["motors-on", "started", "motors-stopped"]);
    }
}

/// Percent never rise, but a firmware that restarts has seen nothing lower yet. 12.4 V read as
/// 12390 mV: 0.037 * 12390 - 363 = 95.
#[test]
fn a_reset_forgets_the_lowest_voltage() {
    let mut bench = Bench::new(in_phase(Profile::Rcj2015));
    let empty = BatteryConfig {
        start_mv: 10_500.0,
        drop_mv_per_s: 0.0,
    };
    bench.base.replace_battery(bench.now, empty);
    bench.run(100 * MS);
    let full = BatteryConfig::default();
    bench.base.replace_battery(bench.now, full);
    bench.base.reset(bench.now, StartCause::PowerOn);
    bench.run(100 * MS);
    assert_eq!(bench.read(35, 1), [95]);
}

/// Turning on the spot: each wheel keeps its sign from the set-point to the encoder.
#[test]
fn a_negative_speed_turns_its_wheel_backwards() {
    let mut bench = Bench::new(in_phase(Profile::Document));
    bench.write(46, &[20, 0xEC, 0]);
    bench.run(800 * MS);
    let read = bench.read(36, 10);
    let right = i32::from_le_bytes(read[4..8].try_into().unwrap());
    assert!(right < -200, "{right}");
    assert!((-22..=-18).contains(&read[9].cast_signed()), "{read:?}");
    assert!(bench.world.turn_rate() < 0.0);
}

/// Maximum time that the robot drives in silence, by the profile.
#[test]
fn the_promised_silence_holds_for_every_phase() {
    for profile in [Profile::Document, Profile::Rcj2015] {
        let promised = profile.silence_max().expect("it stops");
        let kept = phases(24).all(|phase| {
            let mut bench = Bench::new(with_phase(profile, phase));
            bench.send(Frame::write(46, &[20, 20, 0], bench.order()).as_bytes());
            bench.run(promised);
            bench.base.set_points() == [0, 0]
        });
        assert!(kept, "{profile}");
    }
    assert_eq!(Profile::Rcj2014.silence_max(), None);
}
