//! Each rule with a guilty and an innocent master.

use super::*;

/// The rules broken by a master that sends `frames` with a pause between them.
fn broken_by(profile: Profile, frames: &[&[u8]]) -> Vec<&'static str> {
    let mut bench = Bench::new(in_phase(profile));
    for frame in frames {
        bench.ask(frame);
    }
    bench.broken()
}

fn read(profile: Profile, register: u8, count: u8) -> Vec<u8> {
    let order = profile.quirks().checksum;
    Frame::read(register, count, order).as_bytes().to_vec()
}

fn write(profile: Profile, register: u8, data: &[u8]) -> Vec<u8> {
    let order = profile.quirks().checksum;
    Frame::write(register, data, order).as_bytes().to_vec()
}

/// An empty list of rules.
const NONE: [&str; 0] = [];
const DOCUMENT: Profile = Profile::Document;
const FIELD: Profile = Profile::Rcj2015;
const BOTH: [Profile; 2] = [DOCUMENT, FIELD];

/// Requests of the rescue robot's program in the field: read 36..=45, write 46..=48, read 33..=35.
#[test]
fn the_robots_own_program_breaks_no_rule() {
    for profile in Profile::ALL {
        let requests = [
            read(profile, 36, 10),
            write(profile, 46, &[20, 0xEC, 0]),
            read(profile, 33, 3),
            write(profile, 46, &[35, 0xDD, 0]),
            write(profile, 49, &[1, 2, 3, 4]),
            read(profile, 0, 53),
        ];
        let requests = requests.each_ref().map(Vec::as_slice);
        assert_eq!(broken_by(profile, &requests), NONE, "{profile}");
    }
}

#[test]
fn registers_beyond_the_map_are_told() {
    for profile in BOTH {
        let guilty = broken_by(profile, &[&read(profile, 50, 10)]);
        assert_eq!(guilty, [rules::UNKNOWN_REGISTER]);
        let guilty = broken_by(profile, &[&read(profile, 50, 4)]);
        assert_eq!(guilty, [rules::UNKNOWN_REGISTER]);
        let innocent = broken_by(profile, &[&read(profile, 50, 3)]);
        assert_eq!(innocent, NONE);
    }
}

#[test]
fn writes_to_what_the_base_feeds_are_told() {
    for profile in BOTH {
        let guilty = broken_by(profile, &[&write(profile, 35, &[1])]);
        assert_eq!(guilty, [rules::WRITE_READ_ONLY]);
        let innocent = broken_by(profile, &[&write(profile, 13, &[1])]);
        assert_eq!(innocent, NONE);
    }
}

#[test]
fn half_values_are_told() {
    for profile in BOTH {
        let guilty = broken_by(profile, &[&read(profile, 36, 2)]);
        assert_eq!(guilty, [rules::VALUE_CUT]);
        let guilty = broken_by(profile, &[&read(profile, 34, 2)]);
        assert_eq!(guilty, [rules::VALUE_CUT]);
        let innocent = broken_by(profile, &[&read(profile, 40, 4)]);
        assert_eq!(innocent, NONE);
    }
}

#[test]
fn speeds_beyond_the_limit_are_told() {
    for profile in BOTH {
        let guilty = broken_by(profile, &[&write(profile, 46, &[0, 0x80, 0])]);
        assert_eq!(guilty, [rules::SET_POINT_OUT_OF_RANGE]);
        let innocent = broken_by(profile, &[&write(profile, 47, &[0xDD])]);
        assert_eq!(innocent, NONE);
    }
}

#[test]
fn wrong_checksums_are_told_with_both_sums() {
    let mut bench = Bench::new(in_phase(FIELD));
    bench.ask(&hex("AB 24 0A 00 00"));
    let event = bench.base.take_events().remove(0);
    assert_eq!(event.rule, rules::BAD_CHECKSUM);
    assert_eq!(event.detail, "checksum is 0000, expected 00D9");
    assert_eq!(event.bytes, hex("AB 24 0A 00 00"));
}

#[test]
fn frames_without_end_are_told() {
    for profile in BOTH {
        let guilty = broken_by(profile, &[&read(profile, 36, 10)[..4], &[]]);
        assert_eq!(guilty, [rules::FRAME_CUT_OFF], "{profile}");
    }
}

#[test]
fn pauses_inside_a_frame_are_told() {
    for profile in BOTH {
        let told = |gap: Duration| {
            let mut bench = Bench::new(in_phase(profile));
            let frame = read(profile, 36, 10);
            bench.send(&frame[..3]);
            bench.run(gap);
            bench.send(&frame[3..]);
            bench.run(MS);
            bench.broken()
        };
        assert_eq!(told(MS + MS / 2), [rules::GAP_IN_FRAME]);
        assert_eq!(told(MS / 2), NONE);
    }
}

#[test]
fn bytes_between_frames_are_told() {
    for profile in BOTH {
        let guilty = broken_by(profile, &[&[0x00, 0x11], &read(profile, 36, 10)]);
        assert_eq!(guilty, [rules::STRAY_BYTES], "{profile}");
    }
}

#[test]
fn requests_that_do_not_wait_for_the_reply_are_told() {
    let told = |profile: Profile, gap: Duration| {
        let mut bench = Bench::new(in_phase(profile));
        // The base is observed after the next tick.
        bench.run(MS / 5);
        bench.send(&read(profile, 36, 10));
        bench.run(gap);
        bench.send(&read(profile, 36, 10));
        bench.run(MS);
        bench.broken()
    };
    assert_eq!(told(FIELD, Duration::ZERO), [rules::BYTES_WHILE_BUSY]);
    // After 140 us the base listens again but still answers, because 15 bytes take 150 us.
    let early = Duration::from_micros(140);
    assert_eq!(told(FIELD, early), [rules::REQUEST_BEFORE_REPLY]);
    assert_eq!(told(FIELD, MS), NONE);
    assert_eq!(
        told(DOCUMENT, Duration::ZERO),
        [rules::REQUEST_BEFORE_REPLY]
    );
    assert_eq!(told(DOCUMENT, MS), NONE);
}

#[test]
fn more_requests_than_the_queue_holds_are_told() {
    let guilty = broken_by(DOCUMENT, &[&read(DOCUMENT, 0, 53).repeat(9)]);
    assert!(guilty.contains(&rules::REQUEST_BEFORE_REPLY), "{guilty:?}");
    // With an answer after 50 us and a request every 50 us the queue stays short. It fills when the
    // rig delivers a burst at once.
    let mut bench = Bench::new(in_phase(DOCUMENT));
    let burst = read(DOCUMENT, 0, 1).repeat(9);
    bench.run(MS);
    bench.base.receive(AvrBase::BUS, bench.now, &burst);
    bench.poll();
    assert!(bench.broken().contains(&rules::QUEUE_FULL));
}

#[test]
fn a_count_that_the_firmware_cannot_count_to_is_told() {
    let guilty = broken_by(FIELD, &[&write(FIELD, 0, &[0; 127]), &[]]);
    assert_eq!(guilty, [rules::COUNT_TOO_LARGE, rules::FRAME_CUT_OFF]);
}

#[test]
fn talking_to_a_base_that_starts_is_told() {
    for profile in BOTH {
        let mut bench = Bench::new(in_phase(profile));
        bench.base.reset(bench.now, StartCause::PowerOn);
        bench.send(&read(profile, 36, 10));
        assert_eq!(bench.broken(), [rules::BYTES_WHILE_STARTING]);
        bench.run(40 * MS);
        bench.ask(&read(profile, 36, 10));
        assert_eq!(bench.broken(), NONE);
    }
}

#[test]
fn a_wrong_line_is_told() {
    let mut bench = Bench::new(in_phase(DOCUMENT));
    let now = bench.now;
    let event = |base: &mut AvrBase, event| base.line_event(AvrBase::BUS, now, event);
    event(&mut bench.base, LineEvent::FramingError);
    event(&mut bench.base, LineEvent::Break);
    event(&mut bench.base, LineEvent::Opened);
    assert_eq!(bench.broken(), [rules::FRAMING_ERROR, rules::BREAK]);
}

/// The base reports the button by the status register, without a request: bit 1 is "motors off".
#[test]
fn the_documented_base_tells_of_its_stop_button_if_asked_to() {
    let mut bench = Bench::new(AvrBaseConfig {
        announce: Announce::StopButton,
        ..in_phase(DOCUMENT)
    });
    bench.base.press_stop(bench.now);
    bench.run(MS);
    // The checksum is AB + 00 + 81 + 02 = 012E.
    assert_eq!(bench.take(), hex("AB 00 81 02 2E 01"));
    let mut bench = Bench::new(in_phase(DOCUMENT));
    bench.base.press_stop(bench.now);
    bench.run(MS);
    assert_eq!(bench.take(), [0_u8; 0]);
    assert_eq!(bench.read(0, 1), [2]);
}

/// The button's hold ends at its time.
#[test]
fn a_button_that_was_released_holds_until_its_time() {
    let mut bench = Bench::new(config(Profile::default()));
    let now = bench.base.now;
    let mut is_stopped = |button| {
        bench.base.button = button;
        bench.base.is_stopped()
    };
    assert!(is_stopped(ButtonState::Pressed) && is_stopped(ButtonState::Toggled));
    assert!(is_stopped(ButtonState::Lingering(
        now + Duration::from_nanos(1)
    )));
    assert!(!is_stopped(ButtonState::Lingering(now)) && !is_stopped(ButtonState::Released));
}

/// Holds for the document's receiver, which searches its buffer, and for the fielded one.
#[test]
fn a_receiver_waits_until_a_frame_begins() {
    for profile in Profile::ALL {
        let mut bench = Bench::new(config(profile));
        assert!(bench.base.receiver.is_waiting(), "{profile:?}");
        bench.send(&[0xAB, 0x24]);
        assert!(!bench.base.receiver.is_waiting(), "{profile:?}");
        bench.run(PAUSE);
        assert!(bench.base.receiver.is_waiting(), "{profile:?}");
    }
}

/// Nine bytes of ten bits in 810 us: 111,111 baud; the bus has a byte each 10 us.
#[test]
fn each_port_has_its_own_rate() {
    let base = AvrBase::new(AvrBaseConfig::default(), 1);
    let rate = |port| base.line_config(port).byte_time().as_nanos();
    assert_eq!(rate(AvrBase::BUS), 10_000);
    assert!((89_900..=90_100).contains(&rate(AvrBase::DEBUG)));
}
