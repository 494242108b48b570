extern crate std;

use std::vec::Vec as List;

use super::*;

/// Written by hand from the numbers of the fields: tag = number << 3 | wire type (0 whole number,
/// 2 length and bytes, 5 four bytes, little-endian).
#[test]
fn ye2_telemetry_has_the_bytes_that_its_numbers_give() {
    let message = Telemetry {
        timestamp_ms: 300,
        state: Some(State::AutoReactive),
        odometry: Some(Odometry {
            pose: Pose {
                x: 1.0,
                y: -2.0,
                alpha: 0.5,
            },
            covariance: Vec::new(),
        }),
        lidar: Some(Lidar {
            timestamp_ms: 5,
            points: [LidarPoint {
                angle_deg: -1,
                distance_mm: 200,
                quality: 15,
            }]
            .into_iter()
            .collect(),
        }),
        lines: Some([Line::default()].into_iter().collect()),
        infrared: Some(Infrared {
            timestamp_ms: None,
            distances_m: [0.25].into_iter().collect(),
        }),
    };
    let zero = [0x0D, 0, 0, 0, 0, 0x15, 0, 0, 0, 0, 0x1D, 0, 0, 0, 0];
    let expected: List<u8> = [
        // 300 is 0x12C, encoded as AC 02.
        &[0x08, 0xAC, 0x02, 0x12, 0x02, 0x08, 0x03, 0x1A, 17, 0x0A, 15][..],
        &[
            0x0D, 0, 0, 0x80, 0x3F, 0x15, 0, 0, 0, 0xC0, 0x1D, 0, 0, 0, 0x3F,
        ],
        // -1 as a number of 64 bits: nine bytes FF and 01.
        &[
            0x22, 20, 0x08, 0x05, 0x12, 16, 0x08, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF,
        ],
        &[0xFF, 0xFF, 0xFF, 0xFF, 0x01, 0x10, 0xC8, 0x01, 0x18, 0x0F],
        &[0x2A, 36, 0x0A, 34, 0x0A, 15],
        &zero,
        &[0x12, 15],
        &zero,
        &[0x32, 7, 0x12, 5, 0x0D, 0, 0, 0x80, 0x3E],
    ]
    .concat();
    let mut out = [0xA5; 200];
    let len = message.encode(&mut out).unwrap();
    assert_eq!(out[..len], expected);
    assert!(out[len..].iter().all(|byte| *byte == 0xA5));
    assert_eq!(Telemetry::decode(&expected), Ok(message));
}

/// As above; 123456 is 0x47F12000.
#[test]
fn ye2_a_telecommand_has_the_bytes_that_its_numbers_give() {
    let message = Telecommand {
        timestamp_ms: 0,
        state: Some(State::AutoPosition),
        velocities: Some(Velocities {
            linear_m_s: 0.5,
            angular_rad_s: -1.0,
        }),
        corrected_pose: None,
        desired_pose: Some(Pose {
            x: 0.0,
            y: 0.0,
            alpha: ANY_HEADING,
        }),
        lidar_step_deg: Some(10),
        lines: Some(LinesRequest {
            gap_mm: 300,
            tolerance_mm: 60,
            merge_deg: 170,
        }),
        reactive: Some(Reactive {
            speed_m_s: Some(2.0),
            ..Reactive::default()
        }),
    };
    let expected: List<u8> = [
        &[
            0x08, 0, 0x12, 2, 0x08, 4, 0x1A, 10, 0x0D, 0, 0, 0, 0x3F, 0x15, 0, 0, 0x80, 0xBF,
        ][..],
        &[
            0x2A, 15, 0x0D, 0, 0, 0, 0, 0x15, 0, 0, 0, 0, 0x1D, 0x00, 0x20, 0xF1, 0x47,
        ],
        &[
            0x30, 10, 0x3A, 8, 0x08, 0xAC, 0x02, 0x10, 60, 0x18, 0xAA, 0x01,
        ],
        &[0x42, 5, 0x1D, 0, 0, 0, 0x40],
    ]
    .concat();
    let mut out = [0; 100];
    let len = message.encode(&mut out).unwrap();
    assert_eq!(out[..len], expected);
    assert_eq!(Telecommand::decode(&expected), Ok(message));
}

/// Field 15 with each wire type, at both depths; a state without a meaning.
#[test]
fn ye2_fields_that_nobody_knows_are_skipped() {
    let unknown = [
        0x78, 0x96, 0x01, 0x79, 1, 2, 3, 4, 5, 6, 7, 8, 0x7A, 2, 9, 9, 0x7D, 1, 2, 3, 4,
    ];
    let mut bytes: List<u8> = [0x08, 7].into();
    bytes.extend(unknown);
    bytes.extend([0x12, 25, 0x08, 9]);
    bytes.extend(unknown);
    bytes.extend([0x08, 2]);
    let found = Telecommand::decode(&bytes).unwrap();
    let expected = Telecommand {
        timestamp_ms: 7,
        state: Some(State::Manual),
        ..Telecommand::default()
    };
    assert_eq!(found, expected);
    let nonsense = Telecommand::decode(&[0x12, 2, 0x08, 9]).unwrap();
    assert_eq!(nonsense.state, None);
}

#[test]
fn what_is_no_message_is_refused() {
    let decode = |bytes: &[u8]| Telecommand::decode(bytes).unwrap_err();
    assert_eq!(decode(&[0x08]), MessageError::Cut);
    assert_eq!(decode(&[0x12, 5, 0x08, 1]), MessageError::Cut);
    // A group, a length that ends inside a field, a number without an end.
    assert_eq!(decode(&[0x0B]), MessageError::Malformed);
    assert_eq!(decode(&[0x12, 1, 0x08, 1]), MessageError::Malformed);
    assert_eq!(
        decode(&[
            0x08, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 1
        ]),
        MessageError::Malformed
    );
    let line = [0x0A, 0];
    let lines: List<u8> = [0x2A, 42]
        .into_iter()
        .chain(line.into_iter().cycle().take(42))
        .collect();
    assert_eq!(Telemetry::decode(&lines), Err(MessageError::TooMany));
    assert_eq!(
        Telemetry::decode(&[&[0x2A, 40], &lines[2..42]].concat())
            .unwrap()
            .lines
            .map(|lines| lines.len()),
        Some(20)
    );
}

/// The robot's buffer holds 3,200 bytes. A point has a tag, a length, an angle of 2 bytes below 128
/// degrees and 3 above, a distance of 3 bytes and a quality of 2. All points have 128 * 9 + 232 *
/// 10 bytes; before them come times and lengths of 11 bytes. The fielded robot counts 3,525
/// together with its state and odometry.
#[test]
fn a_scan_of_a_point_a_degree_does_not_fit() {
    let scan = |step: usize| Telemetry {
        timestamp_ms: 100_000,
        lidar: Some(Lidar {
            timestamp_ms: 100_000,
            points: (0..360)
                .step_by(step)
                .map(|angle_deg| LidarPoint {
                    angle_deg,
                    distance_mm: 10_000,
                    quality: 15,
                })
                .collect(),
        }),
        ..Telemetry::default()
    };
    let mut out = [0; super::super::PAYLOAD_MAX];
    assert!(scan(2).encode(&mut out).is_ok());
    let refused = scan(1).encode(&mut out);
    assert_eq!(
        refused,
        Err(MessageError::NoRoom {
            len: 3_483,
            room: 3_200
        })
    );
    let lines = Telemetry {
        lines: Some([Line::default(); LINES_MAX].into_iter().collect()),
        ..Telemetry::default()
    };
    // The message's tag and two bytes of length, and the time.
    assert_eq!(lines.encode(&mut out), Ok(20 * 36 + 3 + 2));
}

/// 1.0 is 00 00 80 3F, -2.0 is 00 00 00 C0. Libraries write the values of a covariance one by one
/// or packed into one field; three bytes more are no value.
#[test]
fn a_covariance_is_read_in_both_forms() {
    let odometry = |field: &[u8]| {
        let zero = [
            0x0A, 15, 0x0D, 0, 0, 0, 0, 0x15, 0, 0, 0, 0, 0x1D, 0, 0, 0, 0, 0x12,
        ];
        let len = |of: usize| u8::try_from(of).unwrap();
        let inner = [&zero[..], &[len(field.len())], field].concat();
        [&[0x08, 0, 0x1A, len(inner.len())][..], &inner].concat()
    };
    let one_by_one = odometry(&[0x0D, 0, 0, 0x80, 0x3F, 0x0D, 0, 0, 0, 0xC0]);
    let packed = odometry(&[0x0A, 8, 0, 0, 0x80, 0x3F, 0, 0, 0, 0xC0]);
    let longer = odometry(&[0x0A, 11, 0, 0, 0x80, 0x3F, 0, 0, 0, 0xC0, 9, 9, 9]);
    let message = Telemetry {
        odometry: Some(Odometry {
            pose: Pose::default(),
            covariance: [1.0, -2.0].into_iter().collect(),
        }),
        ..Telemetry::default()
    };
    let mut out = [0; 100];
    let len = message.encode(&mut out).unwrap();
    assert_eq!(out[..len], one_by_one);
    for bytes in [one_by_one, packed, longer] {
        assert_eq!(Telemetry::decode(&bytes), Ok(message.clone()));
    }
    let values = |count: usize| odometry(&[0x0D, 0, 0, 0x80, 0x3F].repeat(count));
    assert!(Telemetry::decode(&values(9)).is_ok());
    assert_eq!(Telemetry::decode(&values(10)), Err(MessageError::TooMany));
}

/// 2.0, 3.0, 4.0 and 0.25 end in 00 40, 40 40, 80 40 and 80 3E.
#[test]
fn fields_that_are_rarely_sent_have_their_numbers() {
    let both = |message: Telecommand, expected: &[u8]| {
        let mut out = [0; 100];
        let len = message.encode(&mut out).unwrap();
        assert_eq!(&out[..len], expected);
        assert_eq!(Telecommand::decode(expected), Ok(message));
    };
    let corrected = Telecommand {
        corrected_pose: Some(Pose {
            x: 2.0,
            y: 3.0,
            alpha: 4.0,
        }),
        ..Telecommand::default()
    };
    let pose = [
        0x0D, 0, 0, 0, 0x40, 0x15, 0, 0, 0x40, 0x40, 0x1D, 0, 0, 0x80, 0x40,
    ];
    both(corrected, &[&[0x08, 0, 0x22, 15][..], &pose].concat());
    let reactive = Telecommand {
        reactive: Some(Reactive {
            distance_min_m: Some(2.0),
            distance_max_m: Some(3.0),
            speed_m_s: Some(4.0),
            turn_gain: Some(0.25),
        }),
        ..Telecommand::default()
    };
    let gain = [0x25, 0, 0, 0x80, 0x3E];
    both(reactive, &[&[0x08, 0, 0x42, 20][..], &pose, &gain].concat());
}

/// A line from (2, 3) to (0.25, 0), and readings with their time.
#[test]
fn ends_of_a_line_and_the_time_of_readings_are_kept_apart() {
    let message = Telemetry {
        lines: Some(
            [Line {
                start: Pose {
                    x: 2.0,
                    y: 3.0,
                    alpha: 0.0,
                },
                end: Pose {
                    x: 0.25,
                    y: 0.0,
                    alpha: 0.0,
                },
            }]
            .into_iter()
            .collect(),
        ),
        infrared: Some(Infrared {
            timestamp_ms: Some(300),
            distances_m: Vec::new(),
        }),
        ..Telemetry::default()
    };
    let expected: List<u8> = [
        &[0x08, 0, 0x2A, 36, 0x0A, 34][..],
        &[
            0x0A, 15, 0x0D, 0, 0, 0, 0x40, 0x15, 0, 0, 0x40, 0x40, 0x1D, 0, 0, 0, 0,
        ],
        &[
            0x12, 15, 0x0D, 0, 0, 0x80, 0x3E, 0x15, 0, 0, 0, 0, 0x1D, 0, 0, 0, 0,
        ],
        &[0x32, 3, 0x08, 0xAC, 0x02],
    ]
    .concat();
    let mut out = [0; 100];
    let len = message.encode(&mut out).unwrap();
    assert_eq!(out[..len], expected);
    assert_eq!(Telemetry::decode(&expected), Ok(message));
}

#[test]
fn states_and_errors_have_words() {
    let names = State::ALL.map(State::name);
    assert_eq!(names, ["off", "manual", "auto-reactive", "auto-position"]);
    let (len, room) = (5, 4);
    let told = [
        (
            MessageError::NoRoom { len, room },
            "message has 5 bytes and does not fit into 4",
        ),
        (MessageError::Cut, "message ends inside a field"),
        (
            MessageError::Malformed,
            "message holds bytes that are no field",
        ),
        (MessageError::TooMany, "message repeats a field too often"),
    ];
    for (error, text) in told {
        assert_eq!(std::format!("{error}"), text);
    }
}
