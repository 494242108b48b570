//! rosbag2 in SQLite (`.db3`): a table of topics, and one of messages.

use std::collections::BTreeMap;

use protocols::Instant;

use super::sqlite::{self, Database, Table, Value};
use super::{BagError, Contents, Meaning};
use crate::finding::{Findings, Kind};

/// First bytes of every file.
pub const MAGIC: &[u8] = sqlite::MAGIC;

/// Adds the content of a file, skipping damaged parts.
///
/// # Errors
/// If the tables of a bag are missing.
pub fn read_into(contents: &mut Contents, bytes: &[u8]) -> Result<(), BagError> {
    let Some(mut file) = Database::open(bytes) else {
        return Err(BagError("the header of its SQLite file is damaged".into()));
    };
    let topics = topics(&mut file, &mut contents.findings);
    let messages = file.table("messages", &mut contents.findings);
    let columns = messages
        .as_ref()
        .and_then(|messages| columns(messages, ["topic_id", "timestamp", "data"]));
    let (Some(topics), Some(messages), Some(columns)) = (topics, messages, columns) else {
        let what = "has no tables topics and messages, expected a rosbag2";
        return Err(BagError(what.into()));
    };
    let mut findings = Findings::default();
    file.each_row(&messages, &mut findings, &mut |row, values| {
        let [topic, stamp, data] = columns.map(|column| values.get(column));
        let topic = topic.and_then(|topic| topic.integer(row));
        let (Some(Some(topic)), Some(Some(stamp)), Some(Some(data))) = (
            topic.map(|topic| topics.get(&topic)),
            stamp.map(|stamp| stamp.integer(row)),
            data.map(|data| data.blob()),
        ) else {
            let place = format_args!("message {row}");
            let what = format_args!("is no message of a known topic");
            contents.findings.add(Kind::Unreadable, place, what);
            return;
        };
        if let (name, Some(meaning)) = topic {
            let logged = Instant::from_nanos(u64::try_from(stamp).unwrap_or(0));
            contents.message(name, *meaning, logged, data);
        }
    });
    contents.findings.extend(findings);
    contents.sort();
    Ok(())
}

/// Topics by id, with name and interpretation.
type Topics = BTreeMap<i64, (String, Option<Meaning>)>;

fn topics(file: &mut Database<'_>, findings: &mut Findings) -> Option<Topics> {
    let table = file.table("topics", findings)?;
    let columns = columns(&table, ["id", "name", "type", "serialization_format"])?;
    let mut topics = BTreeMap::new();
    file.each_row(&table, findings, &mut |row, values| {
        let [id, words @ ..] = columns.map(|column| values.get(column).copied());
        let [name, kind, form] = words.map(|word| word.and_then(Value::text).unwrap_or_default());
        if let Some(id) = id.and_then(|id| id.integer(row)) {
            topics.insert(id, (name.to_owned(), Meaning::of(form, kind)));
        }
    });
    Some(topics)
}

fn columns<const N: usize>(table: &Table, names: [&str; N]) -> Option<[usize; N]> {
    let found = names.map(|name| table.column(name));
    found
        .iter()
        .all(Option::is_some)
        .then(|| found.map(Option::unwrap_or_default))
}
