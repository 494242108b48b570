//! Folders of rosbag2: `metadata.yaml` lists the files in order.

use std::path::{Component, Path, PathBuf};

/// Extensions of recordings.
const ENDINGS: [&str; 2] = ["mcap", "db3"];
/// Additional extensions of compressed recordings.
const PACKED: [&str; 4] = ["zstd", "zst", "lz4", "gz"];

/// The files of a folder: those listed in its `metadata.yaml`, or else its only recording.
///
/// # Errors
/// If the folder cannot be read, has no recording, or has several recordings without an order.
pub fn files(dir: &Path) -> Result<Vec<PathBuf>, String> {
    let text = safefs::read_text(&dir.join("metadata.yaml")).unwrap_or_default();
    let named = named(&text);
    if !named.is_empty() {
        return Ok(named.iter().map(|name| inside(dir, name)).collect());
    }
    let entries = std::fs::read_dir(dir).map_err(|error| format!("cannot be read: {error}"))?;
    let paths = entries.flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = paths.filter(|path| is_recording(path)).collect();
    files.sort();
    match files.len() {
        0 => Err(
            "contains neither capture.pcapng nor an .mcap or .db3 file: expected a result folder \
             or a rosbag2"
                .to_owned(),
        ),
        1 => Ok(files),
        count => Err(format!(
            "holds {count} recordings and no metadata.yaml that names them: name the file"
        )),
    }
}

/// The entries of `relative_file_paths`.
fn named(text: &str) -> Vec<&str> {
    let mut lines = text.lines().map(str::trim);
    let Some(first) = lines.find_map(|line| line.strip_prefix("relative_file_paths:")) else {
        return Vec::new();
    };
    if let Some(list) = first.trim().strip_prefix('[') {
        let words = list.trim_end_matches(']').split(',').map(bare);
        return words.filter(|word| !word.is_empty()).collect();
    }
    lines
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .map_while(|line| line.strip_prefix("- "))
        .map(bare)
        .collect()
}

/// A yaml scalar without quotes.
fn bare(word: &str) -> &str {
    word.trim().trim_matches(['"', '\''])
}

/// The path of a file in the folder. Of a path outside the folder only the file name is used; old
/// bags prefix the name of their folder.
fn inside(dir: &Path, name: &str) -> PathBuf {
    let path = Path::new(name);
    let is_plain = path
        .components()
        .all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    let whole = dir.join(path);
    if is_plain && whole.is_file() {
        return whole;
    }
    dir.join(path.file_name().unwrap_or_default())
}

fn is_recording(path: &Path) -> bool {
    let ending = |path: &Path, known: &[&str]| {
        let ending = path.extension().unwrap_or_default();
        known.iter().any(|known| ending == *known)
    };
    let stem = path.with_extension("");
    path.is_file() && (ending(path, &ENDINGS) || ending(path, &PACKED) && ending(&stem, &ENDINGS))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_names_the_files_in_their_order() {
        let text = "rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths:\n    \
                    - way_1.mcap\n    - \"way_0.mcap\"\n  duration:\n    - 3\n";
        assert_eq!(named(text), ["way_1.mcap", "way_0.mcap"]);
        assert_eq!(
            named("relative_file_paths: [a.db3, 'b.db3']"),
            ["a.db3", "b.db3"]
        );
        assert_eq!(named(""), [""; 0]);
    }

    #[test]
    fn no_file_outside_the_folder_is_named() {
        let dir = Path::new("bag");
        for name in ["../../etc/a.db3", "/etc/a.db3", "bag/a.db3"] {
            assert_eq!(inside(dir, name), dir.join("a.db3"));
        }
    }
}
