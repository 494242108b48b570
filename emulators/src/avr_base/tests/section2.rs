//! Twelve observations of field firmware b77a6df, run in a simulated ATmega2560 with 10 us a byte
//! and each byte injected at its very end: one test, or more, for each of their numbers. Expected
//! figures are the observed ones.

use super::*;
use crate::avr_base::ticks::TICK;

const US: Duration = Duration::from_micros(1);

fn fielded() -> Bench {
    Bench::new(in_phase(Profile::Rcj2015))
}

/// A base whose timer started so that the divider counts at 1005.291 ms, as in the observations.
fn observed() -> Bench {
    let mut bench = fielded();
    let config = bench.base.config.clone();
    bench.base = AvrBase::new(config, 7);
    bench.now = Instant::ZERO;
    let start = Instant::from_micros(1_291 - 66);
    bench.base.reset(start, StartCause::PowerOn);
    bench.now = start;
    bench.poll();
    bench
}

impl Bench {
    /// Runs to `at`.
    fn run_to(&mut self, at: Instant) {
        self.run(at - self.now);
    }

    /// Sends `bytes` so that the first byte ends at `first`.
    fn send_to(&mut self, first: Instant, bytes: &str) {
        self.run(first - self.now - BUS_LINE.byte_time());
        self.send(&hex(bytes));
    }
}

/// `time` before `at`.
fn before(at: Instant, time: Duration) -> Instant {
    Instant::ZERO + (at - Instant::ZERO).saturating_sub(time)
}

/// Calls `judge` `count` times after a rest, each time 37 us later within the cycle of all tasks.
fn over_phases(count: u32, judge: impl FnMut(&mut Bench)) {
    over_phases_of(in_phase(Profile::Rcj2015), count, judge);
}

fn over_phases_of(config: AvrBaseConfig, count: u32, mut judge: impl FnMut(&mut Bench)) {
    let mut bench = Bench::new(config);
    for n in 0..count {
        bench.run(PAUSE + 37 * US * (n % 97));
        bench.sent.clear();
        judge(&mut bench);
    }
}

/// Latencies of a request, sorted, and their mean, us.
fn latencies(config: AvrBaseConfig, request: &[u8]) -> (Vec<u128>, u128) {
    let mut all = Vec::new();
    over_phases_of(config, 8_000, |bench| {
        bench.send(request);
        let end = bench.now;
        bench.run(4 * MS);
        all.extend(bench.sent.first().map(|&(at, _)| (at - end).as_nanos()));
    });
    all.sort_unstable();
    let mean = all.iter().sum::<u128>() / all.len() as u128;
    (all, mean)
}

/// Whether `found` is within 10 percent of `expected`, both us.
fn is_near(found: u128, expected: u128) -> bool {
    found.abs_diff(expected * 1_000) * 10 <= expected * 1_000
}

/// p50, p75, p90 and mean of `found` against the observed ones.
fn judge_latency((all, mean): &(Vec<u128>, u128), expected: [u128; 4]) -> Result<(), String> {
    let at = |percent: usize| all[all.len() * percent / 100];
    let found = [at(50), at(75), at(90), *mean];
    let near = found.iter().zip(expected).all(|(&f, e)| is_near(f, e));
    if near {
        Ok(())
    } else {
        Err(format!("{found:?}, expected {expected:?}"))
    }
}

#[test]
fn point_01_reply_bytes_have_a_pitch_of_10_0_to_10_2_us() {
    let mut bench = fielded();
    bench.send(&hex("AB 00 35 00 E0"));
    bench.run(4 * MS);
    assert_eq!(bench.sent.len(), 58);
    for pair in bench.sent.windows(2) {
        let pitch = (pair[1].0 - pair[0].0).as_nanos();
        assert!((10_000..=10_200).contains(&pitch), "{pitch}");
    }
}

#[test]
fn point_01_reply_bytes_spread_up_to_290_us_while_bytes_arrive() {
    let mut widest = Vec::new();
    over_phases(300, |bench| {
        bench.send(&hex("AB 24 01 00 D0").repeat(20));
        bench.run(MS);
        let frames = bench.sent.chunks_exact(6);
        let pitches = frames.flat_map(|frame| frame.windows(2).map(|w| w[1].0 - w[0].0));
        widest.push(pitches.max().unwrap_or_default());
    });
    // A tick with the regulator, one of 40, or the analog task, one of 50, takes longer.
    widest.sort_unstable();
    let of_a_tick = widest[widest.len() * 90 / 100];
    assert!((260 * US..=320 * US).contains(&of_a_tick), "{of_a_tick:?}");
}

#[test]
fn point_02_the_replys_register_comes_from_59() {
    let mut bench = fielded();
    assert_eq!(bench.ask(&hex("AB 35 81 EE 02 4F")), hex("AB 35 00 00 E0"));
    assert_eq!(bench.ask(&hex("AB 3B 81 9D 02 04")), hex("AB 9D 00 01 48"));
    assert_eq!(fielded().write(50, &[0x55; 10]), hex("AB 55 00 01 00"));
    let mut bench = fielded();
    assert_eq!(bench.write(53, &[0x11; 126]), hex("AB 11 00 00 BC"));
}

/// Measured on the chip: register, count and pointer are loaded once, and addresses count up. So a
/// write over the request itself does not redirect the rest of its bytes.
#[test]
fn f2_a_write_over_53_does_not_redirect_its_remaining_bytes() {
    let mut bench = fielded();
    bench.write(50, &[1, 2, 3, 0x80]);
    assert_eq!(bench.read(50, 3), [1, 2, 3]);
    assert_eq!(bench.read(0x80, 3), [0; 3]);
    let mut bench = fielded();
    bench.write(49, &[43; 5]);
    assert_eq!(bench.read(46, 3), [0; 3]);
    assert_eq!(bench.read(49, 4), [43; 4]);
}

/// The acknowledgement's register is the byte written at 59 (903 of 903 on the chip), for any start
/// of the write. A write that ends before 59 or begins after it is acknowledged with its own
/// register.
#[test]
fn f2_a_write_that_covers_59_is_acknowledged_with_that_byte() {
    for first in 0..=80_u8 {
        for count in [1, 7, 13, 32, 100] {
            let data: Vec<u8> = (0..count).map(|index| 0x80 | index).collect();
            let mut bench = fielded();
            let reply = bench.write(first, &data);
            let covers = first <= 59 && first + count > 59;
            let expected = if covers {
                data[usize::from(59 - first)]
            } else {
                first
            };
            assert_eq!(reply[1], expected, "{count} bytes at {first}");
        }
    }
    // The chip's own vector: 32 bytes at 47, of which the 13th is B3.
    let data = hex("D3 3A 72 04 3A A8 37 E7 FB 0B 73 6B B3");
    let data = [data, vec![0; 19]].concat();
    assert_eq!(fielded().write(47, &data), hex("AB B3 00 01 5E"));
}

/// An overwritten pointer stays overwritten: the chip sets it once, at its start. Data of later
/// writes goes to its target. If the target cannot be written, the checksum fails.
#[test]
fn f2_a_pointer_that_is_overwritten_stays() {
    let mut bench = fielded();
    bench.write(55, &[0xFB, 0x0B]);
    assert_eq!(bench.read(55, 2), [0xFB, 0x0B]);
    assert_eq!(bench.write(13, &[0x5A]), hex("AB 0D 00 00 B8"));
    assert_eq!(bench.read(13, 1), [0x5A]);
    bench.write(55, &[0x10, 0x00]);
    assert_eq!(bench.write(13, &[0x33]), hex("AB FF 00 01 AA"));
    assert_eq!(bench.read(13, 1), [0x5A]);
}

#[test]
fn f1_the_memory_behind_the_map_is_that_of_the_chip() {
    let mut bench = fielded();
    assert_eq!(
        bench.ask(&hex("AB 37 02 00 E4")),
        hex("AB 37 82 ED 02 02 53")
    );
    bench.run(200 * MS);
    // Low byte of each distance, floor and impasse sensor; information on blocks; battery.
    let places = [
        (1, 257),
        (3, 245),
        (5, 237),
        (7, 255),
        (9, 251),
        (11, 261),
        (21, 247),
        (23, 235),
        (29, 243),
        (31, 249),
        (25, 197),
        (27, 193),
        (15, 195),
        (19, 265),
    ];
    for (register, place) in places {
        let far = |bench: &mut Bench| match u8::try_from(place) {
            Ok(place) => bench.read(place, 2),
            Err(_) => bench.read(255, 13)[usize::from(place - 255_u16)..][..2].to_vec(),
        };
        let shown = bench.read(register, 2);
        assert_eq!(far(&mut bench), shown, "register {register} at {place}");
    }
    // A write there shows in its register with the next pass.
    bench.write(235, &[0x21, 0x43]);
    assert_eq!(bench.read(23, 2), [0x21, 0x43]);
    bench.write(193, &[0x65, 0x07]);
    assert_eq!(bench.read(27, 2), [0x65, 0x07]);
    assert_eq!(bench.read(59, 2), [59, 0x82]);
}

/// The chip's own vector, without an object nearby: 200 mm on the short sensors, 400 on the long
/// one behind, all blocks wanted and measured, a battery reading of 846, which is 12.39 V.
#[test]
fn f1_a_read_over_the_end_of_the_sensors_is_the_chips() {
    let mut bench = fielded();
    bench.run(400 * MS);
    let reply = bench.ask(&hex("AB FF 3B 01 E5"));
    let expected = hex("AB FF BB C8 00 C8 00 00 00 90 01 07 07 4E 03");
    assert_eq!(reply[..expected.len()], expected);
    assert_eq!(
        bench.read(33, 1),
        [0x30],
        "millivolts lie nowhere behind the map"
    );
}

/// 79 bytes at 255 reach the motors' state; the chip then reads 44 as the left wheel's count.
#[test]
fn f3_a_write_over_the_motors_state_changes_it() {
    let mut bench = fielded();
    bench.run(400 * MS);
    let mut data = [0; 79];
    data[283 - 255] = 0x44;
    data[295 - 255..][..2].copy_from_slice(&[0x22, 0x11]);
    assert_eq!(bench.write(255, &data), hex("AB FF 00 01 AA"));
    assert_eq!(bench.read(36, 1), [0x44]);
    assert_eq!(bench.read(40, 4), [0x22, 0x11, 0, 0]);
    bench.run(100 * MS);
    // The battery's overwritten reading is measured again: 95 percent.
    assert_eq!(bench.read(33, 4), [0x30, 0x00, 0x5F, 0x44]);
    // A measured speed stays until the regulator runs: at most 40 ms.
    let mut data = bench.read(255, 79);
    data[279 - 255] = 0x77;
    bench.write(255, &data);
    assert_eq!(bench.base.register(44), 0x77);
    bench.run(50 * MS);
    assert_eq!(bench.read(44, 1), [0]);
    // The switch of the motors, at 303, holds them until a reset.
    let mut data = bench.read(255, 79);
    data[303 - 255] = 1;
    bench.write(255, &data);
    bench.write(46, &[20, 20, 0]);
    bench.run(200 * MS);
    assert!(!bench.world.is_moving());
}

/// The build of 2014 has the same memory, one byte higher.
#[test]
fn f4_the_map_of_2014_begins_one_byte_higher() {
    let mut bench = Bench::new(in_phase(Profile::Rcj2014));
    assert_eq!(bench.read(55, 2), [0xEE, 0x02]);
    // The reply's pointer leads to register 55 of its map: 02AD + 55.
    assert_eq!(bench.read(61, 2), [0xAD + 61, 0x02]);
    assert_eq!(bench.write(53, &[0x11; 126]), hex("AB 11 00 00 BC"));
}

/// AB + 37 + 82 + ED + 02 = 0253 of the reply before, low byte first; AB + FF + 00 = 01AA of the
/// error frame that a wrong checksum gets.
#[test]
fn point_03_the_checksum_of_the_reply_before_lies_behind_the_map() {
    let mut bench = fielded();
    bench.ask(&hex("AB 37 02 00 E4"));
    assert_eq!(bench.read(63, 2), [0x53, 0x02]);
    assert_eq!(bench.ask(&hex("AB 37 02 00 E5")), hex("AB FF 00 01 AA"));
    assert_eq!(bench.read(63, 2), [0xAA, 0x01]);
}

/// 12.4 V and then 10.5 V, in steps of the converter: a reading is 15 mV, 20 of them no voltage.
#[test]
fn point_03_the_battery_behind_the_map_is_live() {
    let mut bench = fielded();
    let mut at_volts = |start_mv: f64| {
        let drop_mv_per_s = 0.0;
        let battery = BatteryConfig {
            start_mv,
            drop_mv_per_s,
        };
        bench.base.replace_battery(bench.now, battery);
        bench.run(200 * MS);
        let reading = bench.read(255, 12)[10..].to_vec();
        u16::from_le_bytes([reading[0], reading[1]])
    };
    assert_eq!([at_volts(12_400.0), at_volts(10_500.0)], [846, 720]);
}

#[test]
fn point_04_no_write_reaches_the_task_table() {
    let mut bench = fielded();
    let reply = bench.ask(&hex(
        "AB FF 8E FF FF FF FF FF FF FF FF FF FF FF FF FF FF 10 2A",
    ));
    assert_eq!(reply, hex("AB FF 00 01 AA"));
    bench.run(3 * MS);
    bench.send(&hex("AB 24"));
    bench.run(57 * MS);
    bench.sent.clear();
    bench.send(&hex("AB 24 01 00 D0"));
    bench.run(4 * MS);
    assert_eq!(bench.take(), hex("AB 24 81 00 01 50"));
}

/// Shares of 1,000 bursts with three and with four answers, percent.
fn burst_shares(request: &[u8]) -> [usize; 2] {
    let mut answers = [0; 21];
    over_phases(1_000, |bench| {
        bench.send(&request.repeat(20));
        bench.run(4 * MS);
        answers[(bench.take().len() / 6).min(20)] += 1;
    });
    [answers[3] / 10, answers[4] / 10]
}

fn judge_burst([three, four]: [usize; 2]) -> Result<(), String> {
    let holds = three.abs_diff(74) <= 5 && four.abs_diff(24) <= 5;
    if holds {
        Ok(())
    } else {
        Err(format!("{three} and {four} percent"))
    }
}

#[test]
fn point_05_of_twenty_frames_without_a_gap_three_or_four_are_answered() {
    assert_eq!(judge_burst(burst_shares(&hex("AB 24 01 00 D0"))), Ok(()));
}

/// Minimum and maximum time to an answer, ns, of reads that end 1 us behind each of the `ticks`.
fn held_up(bench: &mut Bench, ticks: impl Iterator<Item = u32>) -> [u128; 2] {
    let mut bounds = [u128::MAX, 0];
    for tick in ticks {
        let end = Instant::ZERO + TICK * tick + US;
        bench.send_to(before(end, 4 * BUS_LINE.byte_time()), "AB 24 01 00 D0");
        bench.sent.clear();
        bench.run(3 * MS);
        // At a count a frame may vanish.
        let Some(&(first, _)) = bench.sent.first() else {
            continue;
        };
        let late = (first - end).as_nanos();
        bounds = [bounds[0].min(late), bounds[1].max(late)];
    }
    bounds
}

/// The soonest answer takes 18 us, plus the rest of the tick interrupt at the end of the frame, and
/// a part of a pass of the main loop.
fn assert_held_for(found: u128, work_ns: u128) {
    let expected = 18_000 + work_ns - 1_000;
    let near = (expected - 3_000..=expected + 24_600).contains(&found);
    assert!(near, "{found} ns, expected {expected}");
}

/// A tick delays an answer by 97.4 us, a pass of the main loop by up to 24.6 us more, and the
/// divider's count by 2.7 us. The regulator takes 34 us at rest and 140 us while driving. The
/// analog task takes 967, 967 and 538 us, the tick included.
#[test]
fn point_05_ticks_hold_an_answer_up_for_their_work() {
    let mut bench = fielded();
    let plain = (0..400)
        .map(|n| 20 + 5 * n)
        .filter(|n| n % 25 != 0 && n % 40 != 0);
    let [least, most] = held_up(&mut bench, plain);
    assert_held_for(least, 97_400);
    assert!((most - least).abs_diff(24_600) <= 1_000, "{least} {most}");
    let odd_counts = (0..100).map(|n| 2_025 + 50 * n).filter(|n| n % 40 != 0);
    let [with_count, _] = held_up(&mut bench, odd_counts);
    assert!((2_200..=3_500).contains(&(with_count - least)));
    let standing = (0..100).map(|n| 7_040 + 40 * n).filter(|n| n % 25 != 0);
    assert_held_for(held_up(&mut bench, standing)[0], 97_400 + 34_000);
    for (from, work) in [(12_050, 967_000), (22_150, 967_000), (32_250, 538_000)] {
        let turns = (0..60).map(|n| from + 150 * n).filter(|n| n % 40 != 0);
        assert_held_for(held_up(&mut bench, turns)[0], work + 2_700);
    }
}

/// A run of the regulator with both wheels driven delays an answer by 140 us.
#[test]
fn point_05_the_regulator_holds_an_answer_up_longer_while_it_drives() {
    let mut bench = fielded();
    let mut least = u128::MAX;
    for second in 0..8 {
        bench.write(46, &[20, 20, 0]);
        let ticks = (0..20).map(|n| 1_000 * second + 80 + 40 * n);
        let ticks = ticks.filter(|n| n % 25 != 0);
        least = least.min(held_up(&mut bench, ticks)[0]);
    }
    assert_held_for(least, 97_400 + 140_000);
}

/// In a burst of reads the answer begins 122 us after the burst's start. If the burst begins with a
/// refused read and fifteen zeros, it is 141 us.
#[test]
fn point_05_the_answer_within_a_burst_begins_after_122_or_141_us() {
    let firsts = |bytes: &[u8]| {
        let mut firsts = Vec::new();
        over_phases(500, |bench| {
            let start = bench.now;
            bench.send(bytes);
            bench.run(4 * MS);
            firsts.push((bench.sent[0].0 - start).as_micros());
        });
        firsts.sort_unstable();
        firsts
    };
    let zeros = "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00";
    let all = firsts(&hex("AB 24 01 00 D0").repeat(20));
    assert!((115..=129).contains(&all[250]), "{}", all[250]);
    let all = firsts(&hex(&format!("AB 5B 3F 45 23 {zeros} AB 08 00 00 B3")));
    assert!(all.iter().any(|&at| (139..=143).contains(&at)));
}

#[test]
fn point_05_a_frame_20_to_40_us_behind_is_answered_in_5_percent() {
    let mut both = 0;
    let mut gap_us = 0;
    over_phases(2_000, |bench| {
        gap_us = (gap_us + 13) % 21;
        bench.send(&hex("AB 24 01 00 D0"));
        bench.run(US * (20 + gap_us));
        bench.send(&hex("AB 25 01 00 D1"));
        bench.run(4 * MS);
        both += usize::from(bench.take().len() == 12);
    });
    // The chip's harness of `tests/avr_base` gives 2 percent of 400.
    assert!((20..=160).contains(&both), "{both} of 2000");
}

/// Whether a frame is answered whose first byte ends `after` the analog task's count. A fragment
/// was sent 10 us after the count at 1000.291 ms.
fn behind_the_even_count(after: Duration) -> bool {
    let mut bench = observed();
    let start = Instant::from_micros(1_000_291);
    bench.send_to(start + 10 * US, "AB 24");
    bench.send_to(start + 5_000 * US + after, "AB 24 01 00 D0");
    bench.run(10 * MS);
    !bench.take().is_empty()
}

#[test]
fn point_06_bytes_during_the_analog_task_rescue_a_fragment() {
    let answered = [600, 900, 1_200].map(|us| behind_the_even_count(us * US));
    assert_eq!(answered, [false, false, true]);
}

/// The count of 1030.391 ms is odd: no analog task. 60 us later the fragment is discarded.
#[test]
fn point_07_an_odd_count_gives_the_fragment_up_within_60_us() {
    let answered = |after: Duration| {
        let mut bench = observed();
        let count = Instant::from_micros(1_030_391);
        bench.send_to(before(count, 3 * MS), "AB 24");
        bench.send_to(count + after, "AB 24 01 00 D0");
        bench.run(10 * MS);
        !bench.take().is_empty()
    };
    assert!(answered(60 * US));
    assert!(!answered(20 * US));
}

#[test]
fn point_08_registers_that_the_base_feeds_are_refilled_on_every_pass() {
    let mut bench = fielded();
    bench.run(200 * MS);
    bench.send(&hex("AB 15 82 9C 23 02 01"));
    bench.run(4 * MS);
    bench.sent.clear();
    bench.send(&hex("AB 15 02 00 C2"));
    bench.run(4 * MS);
    assert_eq!(bench.take(), hex("AB 15 82 C8 00 02 0A"));
    for register in (1..=12).chain(15..=16).chain(19..=33).chain([35]) {
        let before = bench.read(register, 1);
        bench.write(register, &[0x5A]);
        assert_eq!(bench.read(register, 1), before, "{register}");
    }
}

/// Time from the 40th count, which falls at `count`, to the log entry of the motor timeout.
fn cleared_after(count: Instant, probe: Option<Duration>) -> Duration {
    let mut bench = observed();
    bench.send_to(before(count, 984 * MS + 100 * US), "AB 2E 82 0B 0C 01 72");
    if let Some(after) = probe {
        bench.send_to(count + after, "AB 2E 02 00 DB");
    }
    bench.run_to(count + 2 * MS);
    let notes = bench.notes();
    notes
        .iter()
        .find(|n| n.1 == "watchdog")
        .expect("it fires")
        .0
        - count
}

#[test]
fn point_09_the_motors_time_out_42_us_after_an_odd_count() {
    let mut bench = observed();
    bench.send_to(Instant::from_micros(1_000_010), "AB 2E 82 0B 0C 01 72");
    bench.run_to(Instant::from_micros(1_984_250));
    bench.sent.clear();
    bench.send(&hex("AB 2E 02 00 DB"));
    bench.run(4 * MS);
    assert_eq!(bench.take(), hex("AB 2E 82 00 00 01 5B"));
    let after = cleared_after(Instant::from_micros(1_984_191), None);
    assert!((30 * US..=60 * US).contains(&after), "{after:?}");
}

/// Here the analog task and a read in its time hold the main loop until after the next tick. The
/// chip of `tests/avr_base` needs 1,049 to 1,058 us without a read.
#[test]
fn point_09_the_motors_time_out_1_06_ms_after_an_even_count() {
    let count = Instant::from_micros(1_291 + 76 * 25_100);
    let after = cleared_after(count, Some(400 * US));
    assert!((1_020 * US..=1_110 * US).contains(&after), "{after:?}");
}

/// Number of valid frames without an answer. The test sends `tries` frames, one at a tick, each
/// `every` ticks from `first` on; the last byte ends within 0.25 ms around the tick.
fn vanished(first: u64, every: u64, tries: u64) -> usize {
    let mut rng = Rng::stream(1, "test.vanish");
    let mut bench = fielded();
    let lost = (0..tries).filter(|n| {
        let tick = Instant::ZERO + TICK * u32::try_from(first + every * n).unwrap();
        let until_tick = 125 * US + 4 * BUS_LINE.byte_time();
        let later = (250 * US).mul_f64(rng.uniform());
        bench.send_to(before(tick, until_tick) + later, "AB 24 01 00 D0");
        bench.run(3 * MS);
        bench.take().is_empty()
    });
    lost.count()
}

/// 21 of 4,000 frames vanish within 0.25 ms around a count. Counts are 25.1 ms apart, so one frame
/// in 100 ends there: 5e-5 of all frames vanish. Three standard deviations of 21 are 14. Without a
/// count nothing vanishes.
#[test]
fn point_10_21_of_4000_sound_frames_vanish_close_to_a_count() {
    let at_a_count = vanished(50, 25, 4_000);
    assert!((10..=32).contains(&at_a_count), "{at_a_count} of 4000");
    assert_eq!(vanished(62, 25, 1_000), 0);
}

#[test]
fn point_11_a_write_of_127_with_more_behind_crashes_in_67_of_300() {
    let mut rng = Rng::stream(1, "test.flood");
    let mut crashed = 0;
    for n in 0..300_u64 {
        let mut bench = with_phase(Profile::Rcj2015, Duration::from_micros(n * 137));
        bench.encoder_tear = 0.0;
        let mut bench = Bench::new(bench);
        let mut flood = hex("AB 00 FF");
        let random = |_| rng.uniform().to_le_bytes()[3];
        flood.extend((0..227 + n).map(random));
        bench.send(&flood);
        bench.run(60 * MS);
        crashed += usize::from(bench.notes().iter().any(|note| note.1 == "crashed"));
    }
    assert!((52..=82).contains(&crashed), "{crashed} of 300");
}

#[test]
fn point_12_latencies_are_distributed_as_observed() {
    let config = in_phase(Profile::Rcj2015);
    let reads = latencies(config.clone(), &hex("AB 24 01 00 D0"));
    assert_eq!(judge_latency(&reads, [33, 40, 104, 49]), Ok(()));
    assert!(is_near(reads.0[0], 18), "{}", reads.0[0]);
    let writes = latencies(config, &hex("AB 2E 82 00 00 01 5B"));
    assert_eq!(judge_latency(&writes, [37, 45, 115, 54]), Ok(()));
}

/// A base whose processor always answers after 33 us has the right median, and all else wrong.
#[test]
fn the_judges_refuse_a_base_with_other_figures() {
    let mut quirks = Profile::Rcj2015.quirks();
    let latency = 33 * US;
    quirks.processor = Processor::Steady { latency };
    let mut steady = in_phase(Profile::Rcj2015);
    steady.quirks = Some(quirks);
    let found = latencies(steady, &hex("AB 24 01 00 D0"));
    assert!(judge_latency(&found, [33, 40, 104, 49]).is_err());
    let writes = latencies(in_phase(Profile::Rcj2015), &hex("AB 2E 82 00 00 01 5B"));
    assert!(judge_latency(&writes, [33, 40, 104, 49]).is_err());
    assert!(judge_burst([1, 0]).is_err());
    assert!(judge_burst([60, 38]).is_err());
    assert!(!is_near(23_000, 18));
    // A reading of ten bytes answers at other times than one of one byte, so that a base with a
    // longer reply fails the burst.
    let longer = burst_shares(&hex("AB 24 0A 00 D9"));
    assert!(judge_burst(longer).is_err());
}
