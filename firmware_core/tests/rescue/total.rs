//! Any input on any port at any time: no panic, and the motors follow their orders.

use core::time::Duration;

use firmware_core::Master;
use firmware_core::robots::rescue::{Config, Rescue};
use proptest::prelude::*;
use protocols::avr::{self, ChecksumOrder};
use protocols::pcui::message::{Mode, Order, Waypoint, encode_order, encode_waypoints};
use protocols::xv11::{Frame, RawReading, SpeedWord};
use protocols::{Decode, Instant, LineEvent, Port, pcui};

/// A port's number and bytes for it: whole frames, damaged frames, or noise.
fn traffic() -> impl Strategy<Value = (u8, Vec<u8>)> {
    let packet = (0_u8..90, any::<u16>(), any::<[[u8; 4]; 4]>()).prop_map(|(index, speed, raw)| {
        let frame = Frame::new(index, SpeedWord(speed), raw.map(RawReading));
        (0, frame.as_bytes().to_vec())
    });
    let turn = (200_u16..5000).prop_map(|distance| {
        let [low, high] = distance.to_le_bytes();
        let raw = RawReading([low, high, 100, 0]);
        let packets = (0..90).map(|index| Frame::new(index, SpeedWord(19_200), [raw; 4]));
        (0, packets.flat_map(|packet| *packet.as_bytes()).collect())
    });
    let reply = (
        prop_oneof![Just(36), Just(33), Just(46), any::<u8>()],
        prop::collection::vec(any::<u8>(), 0..20),
    )
        .prop_map(|(register, data)| {
            let frame = avr::Frame::write(register, &data, ChecksumOrder::LowFirst);
            (1, frame.as_bytes().to_vec())
        });
    let wheels = any::<[u8; 10]>().prop_map(|data| {
        let frame = avr::Frame::write(36, &data, ChecksumOrder::LowFirst);
        (1, frame.as_bytes().to_vec())
    });
    let ack = Just((
        1,
        avr::Frame::read(46, 0, ChecksumOrder::LowFirst)
            .as_bytes()
            .to_vec(),
    ));
    let order = (0_u8..4, any::<[i8; 2]>()).prop_map(|(mode, set_point)| {
        let mode = Mode::from_wire(mode).expect("0 to 3");
        let mut frame = [0; 32];
        let len = encode_order(&Order { mode, set_point }, &mut frame).expect("fits");
        (2, frame[..len].to_vec())
    });
    let list = prop::collection::vec((any::<[i16; 2]>(), any::<i16>(), any::<i16>()), 0..57)
        .prop_map(|points| {
            let list = points
                .into_iter()
                .map(|(position_mm, id, previous)| Waypoint {
                    position_mm,
                    layer: 0,
                    id,
                    previous,
                });
            let mut frame = [0; pcui::FRAME_MAX];
            let len = encode_waypoints(list, &mut frame).expect("fits");
            (2, frame[..len].to_vec())
        });
    let noise = (0_u8..5, prop::collection::vec(any::<u8>(), 1..80));
    let whole = prop_oneof![
        4 => packet, 4 => turn, 2 => reply, 4 => wheels, 2 => ack, 3 => order, 2 => list, 1 => noise
    ];
    (whole, any::<prop::sample::Index>(), any::<u8>(), 0_u8..6).prop_map(
        |((port, mut bytes), at, value, damage)| {
            let at = at.index(bytes.len());
            match damage {
                0 => bytes[at] = value,
                1 => bytes.truncate(at.max(1)),
                2 => bytes.insert(at, value),
                _ => {}
            }
            (port, bytes)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, ..ProptestConfig::default() })]

    /// Every request is one of the four that the robot knows, and its set-points are within the
    /// base's range. All data for the PC is whole frames.
    #[test]
    fn any_bytes_in_any_pieces_at_any_time_are_survived(
        steps in prop::collection::vec((traffic(), 0_u64..400_000, 1_usize..64, 0_u8..20), 1..120)
    ) {
        let mut robot = Rescue::new(Config::default());
        let mut now = Instant::ZERO;
        let (mut base, mut pc) = (avr::Decoder::default(), pcui::Decoder::default());
        for ((port, bytes), micros, piece, event) in steps {
            now += Duration::from_micros(micros);
            for part in bytes.chunks(piece) {
                now += Duration::from_micros(20);
                robot.receive(Port(port), now, part);
            }
            if event == 0 {
                robot.line_event(Port(port), now, LineEvent::Overrun);
                robot.line_event(Port(port), now, LineEvent::Closed);
            }
            for _ in 0..4 {
                robot.poll(now);
            }
            let _ = robot.take_work();
            prop_assert!(robot.poll_at().is_some());
            let mut buf = [0; 300];
            let count = robot.transmit(Rescue::BASE, &mut buf);
            for request in base.push(&buf[..count]) {
                let request = request.expect("whole and valid");
                match (request.register(), request.is_write(), request.count()) {
                    (36, false, 10) | (33, false, 3) => {}
                    (46, true, 3) => {
                        let wheels = [request.data()[0], request.data()[1]].map(u8::cast_signed);
                        prop_assert!(wheels.iter().all(|wheel| (-35..=35).contains(wheel)));
                    }
                    other => prop_assert!(false, "{other:?}"),
                }
            }
            let count = robot.transmit(Rescue::RADIO, &mut buf[..piece]);
            for frame in pc.push(&buf[..count]) {
                let frame = frame.expect("whole and valid");
                prop_assert!(frame.message().is_ok());
            }
            prop_assert_eq!(pc.discarded(), 0);
            robot.transmit(Rescue::MOTOR, &mut buf[..1]);
        }
    }
}
