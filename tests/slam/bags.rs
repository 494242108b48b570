//! Bags of ROS 2: compressed chunks and messages, SQLite, folders of several files; and damage in
//! each of them.

use std::io::Write as _;

use emulators::world::Pose;
use hilrig::slam::bag::{Contents, db3};
use hilrig::slam::finding::Kind;
use proptest::prelude::*;

use crate::command::{Session, text};
use crate::ros::{laser_scan, odometry, room_messages};

/// A message: the number of its topic (0: scans, 1: odometry), its time, and its bytes.
type Message = (u16, f64, Vec<u8>);

fn zstd(bytes: &[u8]) -> Vec<u8> {
    let level = ruzstd::encoding::CompressionLevel::Fastest;
    ruzstd::encoding::compress_to_vec(bytes, level)
}

fn lz4(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
    encoder.write_all(bytes).expect("memory");
    encoder.finish().expect("memory")
}

/// An SQLite file with pages of 512 bytes, so that a scan extends over several pages.
struct Sqlite {
    pages: Vec<Vec<u8>>,
}

const PAGE: usize = 512;

fn varint(number: usize) -> Vec<u8> {
    let seven = |number: usize| u8::try_from(number & 0x7F).expect("seven bits");
    let mut bytes = vec![seven(number)];
    let mut rest = number >> 7;
    while rest > 0 {
        bytes.insert(0, seven(rest) | 0x80);
        rest >>= 7;
    }
    bytes
}

enum Field<'a> {
    Null,
    Number(i64),
    Text(&'a str),
    Blob(&'a [u8]),
}

/// Encodes the values of a row after their types.
fn record(fields: &[Field<'_>]) -> Vec<u8> {
    let (mut kinds, mut values) = (Vec::new(), Vec::new());
    for field in fields {
        let (kind, value) = match field {
            Field::Null => (0, Vec::new()),
            Field::Number(number) => (6, number.to_be_bytes().to_vec()),
            Field::Text(text) => (13 + 2 * text.len(), text.as_bytes().to_vec()),
            Field::Blob(bytes) => (12 + 2 * bytes.len(), bytes.to_vec()),
        };
        kinds.extend(varint(kind));
        values.extend(value);
    }
    // The length includes itself: one byte here, because there are few types.
    [&varint(kinds.len() + 1)[..], &kinds, &values].concat()
}

impl Sqlite {
    fn add(&mut self, page: Vec<u8>) -> u32 {
        self.pages.push(page);
        u32::try_from(self.pages.len()).expect("few")
    }

    /// A leaf's cell; a payload that does not fit continues on further pages.
    fn cell(&mut self, row: usize, record: &[u8]) -> Vec<u8> {
        let head = [varint(record.len()), varint(row)].concat();
        if record.len() <= PAGE - 35 {
            return [&head[..], record].concat();
        }
        let least = (PAGE - 12) * 32 / 255 - 23;
        let here = least + (record.len() - least) % (PAGE - 4);
        let here = if here <= PAGE - 35 { here } else { least };
        let (here, rest) = record.split_at(here);
        let mut next = 0_u32;
        for part in rest.chunks(PAGE - 4).rev() {
            let mut page = [&next.to_be_bytes()[..], part].concat();
            page.resize(PAGE, 0);
            next = self.add(page);
        }
        [&head[..], here, &next.to_be_bytes()].concat()
    }

    /// A page of cells; `right` is given for an inner page.
    fn page(start: usize, cells: &[Vec<u8>], right: Option<u32>) -> Vec<u8> {
        let mut page = vec![0; PAGE];
        let head = if right.is_some() { 12 } else { 8 };
        page[start] = if right.is_some() { 5 } else { 13 };
        page[start + 4] = u8::try_from(cells.len()).expect("few");
        if let Some(right) = right {
            page[start + 8..start + 12].copy_from_slice(&right.to_be_bytes());
        }
        let mut end = PAGE;
        for (index, cell) in cells.iter().enumerate() {
            end -= cell.len();
            page[end..end + cell.len()].copy_from_slice(cell);
            let place = start + head + 2 * index;
            let at = u16::try_from(end).expect("one page");
            page[place..place + 2].copy_from_slice(&at.to_be_bytes());
        }
        page
    }

    /// A table of these rows, one leaf each, with the required number of inner pages.
    fn table(&mut self, rows: &[Vec<u8>]) -> u32 {
        let mut below: Vec<(u32, usize)> = Vec::new();
        for (number, record) in (1..).zip(rows) {
            let cell = self.cell(number, record);
            below.push((self.add(Self::page(0, &[cell], None)), number));
        }
        while below.len() > 1 {
            let parts: Vec<Vec<(u32, usize)>> = below.chunks(20).map(<[_]>::to_vec).collect();
            below.clear();
            for part in parts {
                let (right, last) = part[part.len() - 1];
                let cell =
                    |(page, row): &(u32, usize)| [&page.to_be_bytes()[..], &varint(*row)].concat();
                let cells: Vec<_> = part[..part.len() - 1].iter().map(cell).collect();
                below.push((self.add(Self::page(0, &cells, Some(right))), last));
            }
        }
        below[0].0
    }

    /// A bag with these messages.
    fn bag(messages: &[Message]) -> Vec<u8> {
        let mut file = Self {
            pages: vec![Vec::new()],
        };
        let topics = [
            ("/scan", "sensor_msgs/msg/LaserScan"),
            ("/odom", "nav_msgs/msg/Odometry"),
            ("/rosout", "rcl_interfaces/msg/Log"),
        ];
        let topics = topics.map(|(topic, kind)| {
            let [topic, kind, form] = [topic, kind, "cdr"].map(Field::Text);
            record(&[Field::Null, topic, kind, form, Field::Text("")])
        });
        let messages = messages.iter().map(|(topic, at_s, data)| {
            #[expect(clippy::cast_possible_truncation, reason = "small")]
            let nanos = (at_s * 1e9) as i64;
            let topic = Field::Number(i64::from(*topic) + 1);
            record(&[Field::Null, topic, Field::Number(nanos), Field::Blob(data)])
        });
        let messages: Vec<_> = messages.collect();
        let tables = [
            (
                "topics",
                "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT \
                 NULL,serialization_format TEXT NOT NULL,offered_qos_profiles TEXT NOT NULL)",
                file.table(&topics),
            ),
            (
                "messages",
                "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp \
                 INTEGER NOT NULL, data BLOB NOT NULL)",
                file.table(&messages),
            ),
        ];
        let cells: Vec<_> = (1..)
            .zip(tables)
            .map(|(row, (name, sql, page))| {
                let [kind, one, two, sql] = ["table", name, name, sql].map(Field::Text);
                let record = record(&[kind, one, two, Field::Number(page.into()), sql]);
                file.cell(row, &record)
            })
            .collect();
        let mut first = Self::page(100, &cells, None);
        first[..16].copy_from_slice(db3::MAGIC);
        first[16..18].copy_from_slice(&512_u16.to_be_bytes());
        file.pages[0] = first;
        file.pages.concat()
    }
}

/// Maps the room's log with `hilrig slam`: all 160 scans, and the true end position within 50 mm.
fn maps_the_room(session: &Session, log: &str) {
    let (_, truth) = room_messages();
    let output = session.hilrig(&["slam", log, "--out", "out"]);
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{told}");
    let said = text(&output.stdout);
    assert!(
        said.starts_with("160 scans, 0 skipped, 0 doubtful"),
        "{said}{told}"
    );
    assert!(told.contains("scans of /scan, odometry of /odom"), "{told}");
    let way = session.read("out/trajectory.tum");
    let last = way.lines().last().expect("a line a scan");
    let last: Vec<f64> = last
        .split(' ')
        .filter_map(|field| field.parse().ok())
        .collect();
    let off = libm::hypot(last[1] - truth.x, last[2] - truth.y);
    assert!(off < 0.05, "{off} m off");
}

#[test]
fn a_bag_in_sqlite_becomes_a_map_and_a_way() {
    let session = Session::new("db3");
    let file = Sqlite::bag(&room_messages().0);
    session.write("bag.db3", &file);
    maps_the_room(&session, "bag.db3");
    // A recorder that compresses whole files.
    session.write("bag.db3.zstd", &zstd(&file));
    maps_the_room(&session, "bag.db3.zstd");
}

/// Three files, of which the first one is the last by name; the metadata gives the order. If one is
/// missing, the others are mapped.
#[test]
fn the_files_of_a_folder_are_one_recording() {
    let session = Session::new("folder");
    let (mut messages, _) = room_messages();
    for (_, _, data) in &mut messages {
        // A recorder that compresses each message.
        *data = zstd(data);
    }
    let (first, rest) = messages.split_at(100);
    let (second, third) = rest.split_at(120);
    for (name, part) in [
        ("bag_2.db3", first),
        ("bag_0.db3", second),
        ("bag_1.db3", third),
    ] {
        session.write(name, &Sqlite::bag(part));
    }
    let list = "info:\n  relative_file_paths:\n    - bag_2.db3\n    - bag_0.db3\n    - bag_1.db3\n";
    session.write("metadata.yaml", list.as_bytes());
    maps_the_room(&session, ".");

    std::fs::remove_file(session.path("bag_0.db3")).expect("it was written");
    let output = session.hilrig(&["slam", ".", "--out", "out"]);
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{told}");
    assert!(told.contains("bag_0.db3: cannot be read"), "{told}");
    assert!(
        text(&output.stdout).starts_with("100 scans, 1 skipped"),
        "{told}"
    );
}

/// A file cut in half: the rows of the remaining pages are read, and each missing one is a finding.
#[test]
fn of_a_cut_bag_the_rest_is_read() {
    let file = Sqlite::bag(&room_messages().0);
    let mut contents = Contents::default();
    db3::read_into(&mut contents, &file[..file.len() / 2]).expect("the tables are listed first");
    assert!(contents.findings.count(Kind::Part) > 0);
    let log = contents.log();
    // The table's inner pages come after their leaves here, and are cut off.
    assert!(log.is_err(), "{log:?}");

    let mut spoilt = file.clone();
    let middle = file.len() / 2 / PAGE * PAGE;
    spoilt[middle..middle + 6 * PAGE].fill(0xFF);
    let mut contents = Contents::default();
    db3::read_into(&mut contents, &spoilt).expect("its tables are sound");
    let lost = contents.findings.count(Kind::Part);
    let log = contents.log().expect("most of it is sound");
    assert!((157..160).contains(&log.shots.len()), "{}", log.shots.len());
    assert!((1..6).contains(&lost), "{lost}");
}

#[test]
fn an_sqlite_file_of_something_else_is_told() {
    let session = Session::new("no-bag");
    let mut file = vec![0; PAGE];
    file[..16].copy_from_slice(db3::MAGIC);
    session.write("places.sqlite", &file);
    let told =
        |session: &Session| text(&session.hilrig(&["slam", "places.sqlite"]).stderr).to_owned();
    assert!(told(&session).contains("places.sqlite: the header of its SQLite file is damaged"));
    file[16] = 2;
    file[100] = 13;
    session.write("places.sqlite", &file);
    let told = told(&session);
    assert!(
        told.contains("has no tables topics and messages, expected a rosbag2"),
        "{told}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::default())]
    /// Bytes are changed or cut anywhere: readable data is read, and the reader neither panics nor
    /// hangs.
    #[test]
    fn no_damage_to_a_bag_panics_the_reader(
        flips in proptest::collection::vec((any::<usize>(), 1_u8..), 0..6), cut: usize,
    ) {
        let mut bytes = Sqlite::bag(&few());
        for (place, by) in flips {
            let place = place % bytes.len();
            bytes[place] ^= by;
        }
        bytes.truncate(cut % (2 * bytes.len()));
        let mut contents = Contents::default();
        let read = db3::read_into(&mut contents, &bytes);
        prop_assert!(read.is_ok() || read.is_err_and(|error| !error.to_string().is_empty()));
    }
}

fn few() -> Vec<Message> {
    vec![
        (1, 0.5, odometry(0.5, Pose::default())),
        (0, 1.0, laser_scan(1.0, &[1.0; 90])),
        (0, 2.0, zstd(&laser_scan(2.0, &[2.0; 90]))),
    ]
}

#[cfg(feature = "mcap")]
mod chunks {
    use super::*;
    use crate::messages::file;
    use hilrig::slam::bag::mcap::read;

    /// The opcode of a chunk, and the offsets of its records' size, checksum and compression.
    const CHUNK: u8 = 6;
    const SIZE: usize = 16;
    const NAME: usize = 28;

    /// Function from a chunk's header and records to its body.
    type Change = fn(&[u8], &[u8]) -> Vec<u8>;

    /// The records of a file, each with its opcode.
    fn records(file: &[u8]) -> Vec<(u8, Vec<u8>)> {
        let mut rest = &file[8..file.len() - 8];
        let mut records = Vec::new();
        while let Some((head, behind)) = rest.split_first_chunk::<9>() {
            let length = u64::from_le_bytes(head[1..].try_into().expect("eight"));
            let (body, behind) = behind.split_at(usize::try_from(length).expect("small"));
            records.push((head[0], body.to_vec()));
            rest = behind;
        }
        records
    }

    /// The file with each chunk rebuilt by `change`, from header and records to body.
    fn changed(file: &[u8], mut change: impl FnMut(&[u8], &[u8]) -> Vec<u8>) -> Vec<u8> {
        let magic = &file[..8];
        let mut out = magic.to_vec();
        for (opcode, mut body) in records(file) {
            if opcode == CHUNK {
                // An empty compression name, and eight bytes of length.
                body = change(&body[..NAME], &body[NAME + 12..]);
            }
            out.push(opcode);
            out.extend((body.len() as u64).to_le_bytes());
            out.extend(body);
        }
        out.extend(magic);
        out
    }

    fn chunk(head: &[u8], name: &str, records: &[u8]) -> Vec<u8> {
        let mut body = head.to_vec();
        body.extend(u32::try_from(name.len()).expect("short").to_le_bytes());
        body.extend(name.as_bytes());
        body.extend((records.len() as u64).to_le_bytes());
        body.extend(records);
        body
    }

    fn compressed(file: &[u8], name: &str) -> Vec<u8> {
        let pack = if name == "zstd" { zstd } else { lz4 };
        changed(file, |head, records| chunk(head, name, &pack(records)))
    }

    #[test]
    fn compressed_chunks_become_a_map_and_a_way() {
        let session = Session::new("chunks");
        let plain = file(&room_messages().0);
        for name in ["zstd", "lz4"] {
            let packed = compressed(&plain, name);
            assert!(packed.len() < plain.len(), "{name}: {}", packed.len());
            session.write("bag.mcap", &packed);
            maps_the_room(&session, "bag.mcap");
        }
    }

    /// The second chunk of each file is damaged: wrong data, a wrong size or checksum, too large to
    /// unpack, or an unknown compression. The damage is reported, and all other scans are present.
    #[test]
    fn a_damaged_chunk_costs_its_own_scans() {
        let plain = file(&room_messages().0);
        let all = read(&plain).log().expect("sound").shots.len();
        let damages: [(&str, Change); 6] = [
            ("no zstd", |head, _| chunk(head, "zstd", &[7; 60])),
            ("checksum does not match", |head, records| {
                let mut records = records.to_vec();
                records[200] ^= 1;
                chunk(head, "lz4", &lz4(&records))
            }),
            ("more than 9 bytes", |head, records| {
                let mut head = head.to_vec();
                head[SIZE..SIZE + 8].copy_from_slice(&9_u64.to_le_bytes());
                chunk(&head, "zstd", &zstd(records))
            }),
            (
                "names 1099511627776 bytes, expected at most 1073741824",
                |head, records| {
                    let mut head = head.to_vec();
                    head[SIZE..SIZE + 8].copy_from_slice(&(1_u64 << 40).to_le_bytes());
                    chunk(&head, "zstd", &zstd(records))
                },
            ),
            (
                "compressed by brotli, expected zstd, lz4 or none",
                |head, records| chunk(head, "brotli", records),
            ),
            ("ends in its header", |head, _| head[..20].to_vec()),
        ];
        for (words, damage) in damages {
            let mut number = 0;
            let bytes = changed(&plain, |head, records| {
                number += 1;
                if number == 2 {
                    damage(head, records)
                } else {
                    chunk(head, "lz4", &lz4(records))
                }
            });
            let log = read(&bytes).log().expect("most of it is sound");
            assert_eq!(log.findings.count(Kind::Part), 1, "{words}");
            let told = log.findings.told();
            assert!(
                told.iter().any(|told| told.contains(words)),
                "{words}: {told:?}"
            );
            assert!(
                (all - 8..all).contains(&log.shots.len()),
                "{words}: {}",
                log.shots.len()
            );
        }
    }

    /// An uncompressed chunk with a wrong bit is reported and used: its other scans are valid.
    #[test]
    fn a_wrong_bit_in_a_plain_chunk_is_told() {
        let mut bytes = file(&few());
        let place = bytes
            .windows(4)
            .position(|four| four == 2_f32.to_le_bytes());
        bytes[place.expect("a range of 2 m") + 2] ^= 1;
        let log = read(&bytes).log().expect("two scans");
        assert_eq!((log.shots.len(), log.findings.count(Kind::Part)), (2, 1));
    }

    /// A file that ends in a compressed chunk gives the data before this chunk.
    #[test]
    fn of_a_cut_file_the_rest_is_read() {
        let plain = file(&room_messages().0);
        for name in ["zstd", "lz4"] {
            let packed = compressed(&plain, name);
            let log = read(&packed[..packed.len() / 2]).log().expect("half of it");
            assert!((50..110).contains(&log.shots.len()), "{}", log.shots.len());
            assert_eq!(log.findings.count(Kind::Cut), 1);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::default())]
        #[test]
        fn no_damage_to_a_compressed_chunk_panics_the_reader(
            flips in proptest::collection::vec((any::<usize>(), 1_u8..), 1..8),
            is_zstd: bool, cut: usize,
        ) {
            let name = if is_zstd { "zstd" } else { "lz4" };
            let mut bytes = compressed(&file(&few()), name);
            for (place, by) in flips {
                let place = place % bytes.len();
                bytes[place] ^= by;
            }
            bytes.truncate(cut % (2 * bytes.len()));
            let contents = read(&bytes);
            let told = contents.findings.told().to_vec();
            prop_assert!(!told.iter().any(|told| told.contains("invalid lengths")), "{told:?}");
        }
    }
}
