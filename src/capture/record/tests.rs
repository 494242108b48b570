use super::*;

/// A request of seven bytes at 1 Mbaud, 10 us each, of which the receiver was told one by one
/// but for the last two.
#[test]
fn joined_chunks_come_apart_again_at_their_times() {
    let record = Record {
        link: 0,
        sequence: Some(1),
        at: Instant::from_micros(1_070),
        direction: Direction::ToDevice,
        kind: Kind::Data,
        bytes: vec![1, 2, 3, 4, 5, 6, 7].into(),
        sent: None,
        pieces: vec![1, 1, 1, 1, 1, 2],
        comment: String::new(),
    };
    let mut file = Vec::new();
    Section::default().write(&mut file);
    Interface::new("base", 1_000_000).write(&mut file);
    record.write(0, &mut file);
    let capture = crate::capture::Capture::of(&file);
    assert_eq!(capture.records, [record]);
    let chunks = capture.records[0].chunks(LineConfig::new_8n1(1_000_000));
    let told: Vec<_> = chunks
        .iter()
        .map(|(at, bytes)| (at.as_nanos(), bytes.len()))
        .collect();
    let expected = [
        (1_010_000, 1),
        (1_020_000, 1),
        (1_030_000, 1),
        (1_040_000, 1),
    ];
    assert_eq!(told[..4], expected);
    assert_eq!(told[4..], [(1_050_000, 1), (1_070_000, 2)]);
    let joined: Vec<u8> = chunks
        .iter()
        .flat_map(|(_, bytes)| bytes.to_vec())
        .collect();
    assert_eq!(joined, [1, 2, 3, 4, 5, 6, 7]);
}

/// Six bytes cannot come in pieces of four and four: as if nothing was told.
#[test]
fn lengths_that_do_not_add_up_are_not_believed() {
    assert_eq!(lengths(&[4, 2], 6), Vec::<u8>::new());
    assert_eq!(lengths(&[4, 1, 2, 1], 6), [4, 2]);
    assert_eq!(lengths(&[0, 255, 6, 1, 9], 6), [6]);
}
