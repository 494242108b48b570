use proptest::prelude::*;
use protocols::panel::{FRAME_MAX, ON, PenDecoder, encode_pixels, encode_switch, seal};

use super::*;
use crate::world::{BodyConfig, Pose, Scene};

fn world() -> World {
    let scene = Scene::new(Vec::<crate::world::Fixture>::new(), Vec::new()).expect("empty");
    World::new(scene, BodyConfig::default(), Pose::new(0.0, 0.0, 0.0), 1).expect("sound")
}

fn window([x0, y0]: [u16; 2], [x1, y1]: [u16; 2]) -> Window {
    Window {
        columns: [x0, x1],
        rows: [y0, y1],
    }
}

fn drawing(window: Window, pixels: &[u16]) -> Vec<u8> {
    let mut frame = vec![0; FRAME_MAX];
    let len = encode_pixels(window, pixels, &mut frame).expect("fits");
    frame.truncate(len);
    frame
}

fn rules(panel: &mut TouchPanel) -> Vec<(EventKind, &'static str)> {
    let events = panel.take_events();
    events
        .iter()
        .map(|event| (event.kind, event.rule))
        .collect()
}

/// Two rows of two pixels at (478, 270): the lower right corner, where an index would run over.
#[test]
fn pixels_land_in_their_window() {
    let mut panel = TouchPanel::new(Vec::new());
    let corner = window([478, 270], [479, 271]);
    panel.receive(TouchPanel::UART, Instant::ZERO, &encode_switch(ON));
    panel.receive(
        TouchPanel::UART,
        Instant::ZERO,
        &drawing(corner, &[1, 2, 3, 4]),
    );
    assert!(panel.is_on());
    let (upper, lower) = (270 * 480 + 478, 271 * 480 + 478);
    assert_eq!(panel.pixels()[upper..upper + 2], [1, 2]);
    assert_eq!(panel.pixels()[lower..], [3, 4]);
    assert_eq!(
        panel.pixels().iter().filter(|&&pixel| pixel != 0).count(),
        4
    );
    assert_eq!(rules(&mut panel), [(EventKind::Note, "display-on")]);
}

/// A valid frame without a meaning is the program's mistake. It changes no pixel and is named.
#[test]
fn the_display_judges_what_it_is_asked_for() {
    let mut panel = TouchPanel::new(Vec::new());
    let mut unknown = [0; 6];
    assert_eq!(seal(&mut unknown, 0x55, 0), Some(6));
    panel.receive(TouchPanel::UART, Instant::ZERO, &unknown);
    let beyond = drawing(window([479, 0], [480, 0]), &[7, 7]);
    panel.receive(TouchPanel::UART, Instant::ZERO, &beyond);
    // A window of two pixels, and three in one run.
    let mut short = drawing(window([0, 0], [1, 0]), &[7, 7]);
    assert_eq!(short[12..15], [2, 0, 7]);
    short[12] = 3;
    let len = seal(&mut short, panel::RUNS, 11).expect("fits");
    panel.receive(TouchPanel::UART, Instant::ZERO, &short[..len]);

    let broken = ["unknown-command", "window-outside", "pixel-count"];
    let broken = broken.map(|rule| (EventKind::Violation, rule));
    assert_eq!(rules(&mut panel), broken);
    assert!(panel.pixels().iter().all(|&pixel| pixel == 0));
}

/// A tap of 100 ms, reported every 20 ms: five times down, once up. The middle of column 240 of 480
/// reads 240.5 / 480 * 4096 = 2052.
#[test]
fn a_tap_is_reported_until_the_finger_is_lifted() {
    let at = Instant::from_millis(30);
    let place = [240, 0];
    let mut panel = TouchPanel::new(vec![Tap { at, place }]);
    let (mut world, mut decoder, mut pens) = (world(), PenDecoder::default(), Vec::new());
    while let Some(now) = panel.poll_at() {
        panel.poll(now, &mut world);
        let mut buf = [0; 16];
        let len = panel.transmit(TouchPanel::UART, &mut buf);
        pens.extend(decoder.push(&buf[..len]).flatten().map(|frame| frame.pen()));
    }
    let pen = |contact| {
        let reading = [2052, 7];
        Some(Pen { contact, reading })
    };
    assert_eq!(
        pens,
        [&[pen(Contact::Down); 5][..], &[pen(Contact::Up)]].concat()
    );
}

/// Beside the panel, to the right of it or below it, a finger is not felt.
#[test]
fn a_tap_beside_the_panel_is_not_reported() {
    let mut panel = TouchPanel::new(Vec::new());
    panel.tap(Instant::ZERO, [480, 0]);
    panel.tap(Instant::ZERO, [0, 272]);
    let (mut world, mut tapped) = (world(), 0);
    while let Some(now) = panel.poll_at() {
        panel.poll(now, &mut world);
        assert_eq!(panel.transmit(TouchPanel::UART, &mut [0; 16]), 0);
        tapped += panel.take_events().len();
    }
    assert_eq!(tapped, 2);
}

/// A double tap gives two taps, even when both are requested at once.
#[test]
fn taps_do_not_run_into_each_other() {
    let mut panel = TouchPanel::new(Vec::new());
    panel.tap(Instant::ZERO, [1, 1]);
    panel.tap(Instant::ZERO, [1, 1]);
    let (mut world, mut ups) = (world(), Vec::new());
    while let Some(now) = panel.poll_at() {
        panel.poll(now, &mut world);
        ups.extend(panel.take_events().iter().map(|event| event.at));
    }
    assert_eq!(ups, [Instant::from_millis(100), Instant::from_millis(300)]);
}

/// One frame switches the display on, another one draws a pixel.
#[test]
fn a_frame_that_is_as_it_should_be_is_counted() {
    let mut panel = TouchPanel::new(Vec::new());
    assert_eq!(panel.frames(), [0, 0]);
    panel.receive(TouchPanel::UART, Instant::ZERO, &encode_switch(ON));
    let drawn = drawing(window([5, 5], [5, 5]), &[0xABCD]);
    panel.receive(TouchPanel::UART, Instant::from_millis(20), &drawn);
    assert_eq!(panel.frames(), [2, 0]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4 * ProptestConfig::default().cases))]

    /// Garbage before, between and after frames: after a pause the next frame is drawn.
    #[test]
    fn garbage_costs_no_frame_behind_a_pause(
        garbage in prop::collection::vec(prop_oneof![any::<u8>(), Just(0x7E), Just(0)], 0..2000),
    ) {
        let mut panel = TouchPanel::new(Vec::new());
        panel.receive(TouchPanel::UART, Instant::ZERO, &garbage_or_nothing(&garbage));
        let frame = drawing(window([5, 5], [5, 5]), &[0xABCD]);
        panel.receive(TouchPanel::UART, Instant::from_millis(20), &frame);
        prop_assert_eq!(panel.pixels()[5 * 480 + 5], 0xABCD);
    }
}

/// A receiver is never called with nothing.
fn garbage_or_nothing(garbage: &[u8]) -> Vec<u8> {
    if garbage.is_empty() {
        vec![0]
    } else {
        garbage.to_vec()
    }
}

/// The panel may send while a report of its pen waits.
#[test]
fn a_panel_may_send_while_a_report_waits() {
    let tap = Tap {
        at: Instant::from_millis(100),
        place: [10, 10],
    };
    let (mut panel, mut world) = (TouchPanel::new(vec![tap]), world());
    panel.receive(TouchPanel::UART, Instant::ZERO, &encode_switch(ON));
    panel.poll(Instant::from_millis(99), &mut world);
    assert!(!panel.may_send(TouchPanel::UART));
    panel.poll(Instant::from_millis(100), &mut world);
    assert!(panel.may_send(TouchPanel::UART));
    let mut buf = [0; 64];
    assert!(panel.transmit(TouchPanel::UART, &mut buf) > 0);
    assert!(!panel.may_send(TouchPanel::UART));
}

/// Each rejected candidate is counted.
#[test]
fn damaged_frames_are_counted() {
    let mut panel = TouchPanel::new(Vec::new());
    let mut wrong = encode_switch(ON);
    *wrong.last_mut().expect("a frame") ^= 1;
    let counts = [1, 2, 3].map(|second| {
        panel.receive(TouchPanel::UART, Instant::from_secs(second), &wrong);
        panel.frames()[1]
    });
    assert!(
        counts[0] > 0 && counts[1] > counts[0] && counts[2] > counts[1],
        "{counts:?}"
    );
    panel.receive(TouchPanel::UART, Instant::from_secs(4), &encode_switch(ON));
    assert_eq!(panel.frames()[0], 1);
}

/// Bytes 5 ms apart belong to different frames; with less between them they are one.
#[test]
fn half_a_frame_waits_for_less_than_5_ms() {
    let frames = |pause_us: u64| {
        let mut panel = TouchPanel::new(Vec::new());
        let whole = encode_switch(ON);
        let begin = Instant::from_millis(20);
        panel.receive(TouchPanel::UART, begin, &whole[..3]);
        let later = Instant::from_micros(20_000 + pause_us);
        panel.receive(TouchPanel::UART, later, &whole[3..]);
        (panel.frames()[0], panel.is_on())
    };
    assert_eq!([0, 4_999].map(frames), [(1, true); 2]);
    assert_eq!([5_000, 9_000].map(frames), [(0, false); 2]);
}

/// Row 272 is below the panel; the last row is 271.
#[test]
fn a_window_ends_with_the_rows() {
    let mut panel = TouchPanel::new(Vec::new());
    let below = drawing(window([0, 271], [0, 272]), &[7, 7]);
    panel.receive(TouchPanel::UART, Instant::ZERO, &below);
    let violation = (EventKind::Violation, "window-outside");
    assert_eq!(rules(&mut panel), [violation]);
    assert!(panel.pixels().iter().all(|pixel| *pixel == 0));
}

#[test]
fn the_display_is_switched_when_its_state_changes() {
    let mut panel = TouchPanel::new(Vec::new());
    let mut seen = Vec::new();
    for (at, op) in (0..).zip([ON, ON, panel::OFF, panel::OFF, ON]) {
        let now = Instant::from_millis(20 * at);
        panel.receive(TouchPanel::UART, now, &encode_switch(op));
        seen.push((panel.is_on(), rules(&mut panel)));
    }
    let note = |rule| vec![(EventKind::Note, rule)];
    let expected = [
        (true, note("display-on")),
        (true, vec![]),
        (false, note("display-off")),
        (false, vec![]),
        (true, note("display-on")),
    ];
    assert_eq!(seen, expected);
}

/// In order of time, and in the order of their requests at the same time.
#[test]
fn taps_wait_in_order_and_up_to_a_thousand() {
    let tap = |secs, column| Tap {
        at: Instant::from_secs(secs),
        place: [column, 0],
    };
    let mut panel = TouchPanel::new(vec![tap(3, 30), tap(1, 10)]);
    for (secs, column) in [(2, 20), (3, 31), (1, 11), (0, 0)] {
        panel.tap(Instant::from_secs(secs), [column, 0]);
    }
    let columns: Vec<u16> = panel.taps.iter().map(|tap| tap.place[0]).collect();
    assert_eq!(columns, [0, 10, 11, 20, 30, 31]);

    let mut full = TouchPanel::new(vec![tap(1, 1); TAPS_MAX + 1]);
    assert_eq!(full.taps.len(), TAPS_MAX);
    full.tap(Instant::ZERO, [0, 0]);
    assert_eq!((full.taps.len(), full.taps[0]), (TAPS_MAX, tap(1, 1)));
    full.taps.pop_back();
    full.tap(Instant::ZERO, [0, 0]);
    assert_eq!((full.taps.len(), full.taps[0]), (TAPS_MAX, tap(0, 0)));
}

/// Of 4096 steps: half a pixel from the edges, 4096 / 960 and 4096 / 544, and 959 and 543 of them.
#[test]
fn readings_span_the_panel() {
    assert_eq!(reading_of([0, 0]), [4, 7]);
    assert_eq!(reading_of([479, 271]), [4_091, 4_088]);
    assert_eq!(reading_of([u16::MAX, 272]), [READING_MAX, READING_MAX]);
}

/// A touch of 100 ms that is looked at late: the next report is due 20 ms after that, at most at
/// the finger's end, and the next tap 100 ms after the end.
#[test]
fn the_next_look_is_at_the_next_report() {
    let mut panel = TouchPanel::new(Vec::new());
    let mut world = world();
    for column in [1, 2] {
        panel.tap(Instant::from_millis(10), [column, 0]);
    }
    assert!(!panel.may_send(TouchPanel::UART));
    let mut due = vec![panel.poll_at()];
    for millis in [10, 35, 90, 110] {
        panel.poll(Instant::from_millis(millis), &mut world);
        due.push(panel.poll_at());
        assert!(panel.may_send(TouchPanel::UART));
        panel.take_events();
        while panel.transmit(TouchPanel::UART, &mut [0; 16]) > 0 {}
    }
    let millis = [10, 30, 55, 110, 210].map(|millis| Some(Instant::from_millis(millis)));
    assert_eq!(due, millis);
    panel.poll(Instant::from_millis(209), &mut world);
    assert!(!panel.may_send(TouchPanel::UART));
}

#[test]
fn a_window_beyond_the_panel_is_counted() {
    let mut panel = TouchPanel::new(Vec::new());
    for _ in 0..2 {
        let below = drawing(window([0, 271], [0, 272]), &[7, 7]);
        panel.receive(TouchPanel::UART, Instant::ZERO, &below);
    }
    let broken = panel.broken_rules().expect("it has a log");
    assert!(broken.iter().eq([("window-outside", 2)]));
}

/// Three pixels of one colour and two of another are two runs.
#[test]
fn runs_of_pixels_are_drawn_one_behind_the_other() {
    let mut panel = TouchPanel::new(Vec::new());
    let drawn = drawing(window([10, 1], [14, 1]), &[7, 7, 7, 9, 9]);
    assert_eq!(drawn[1], panel::RUNS);
    panel.receive(TouchPanel::UART, Instant::ZERO, &drawn);
    let row = &panel.pixels()[WIDTH..2 * WIDTH];
    assert_eq!(row[9..16], [0, 7, 7, 7, 9, 9, 0]);
    assert_eq!(panel.frames(), [1, 0]);
}
