use super::*;

/// First bytes of a recording; each file begins with them.
fn head() -> Vec<u8> {
    [&SECTION.to_le_bytes()[..], b"head"].concat()
}

/// A folder for this test only.
fn folder(name: &str) -> PathBuf {
    let name = format!("hilrig-files-{name}-{}", std::process::id());
    let folder = std::env::temp_dir().join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("writable");
    folder
}

/// A recording in which each block fills a file and one renamed file is kept.
fn files(folder: &Path) -> io::Result<Files> {
    let limits = Limits {
        file_bytes: 10,
        files: 1,
        existing: Existing::SetAside,
    };
    Files::create(&folder.join("live.pcapng"), head(), limits)
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("there");
    let name = |entry: io::Result<fs::DirEntry>| entry.expect("there").file_name();
    let mut names: Vec<String> = entries
        .map(|entry| name(entry).to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// Another process moves the files away while the recording writes them.
#[test]
fn a_file_that_was_moved_away_ends_nothing() {
    let folder = folder("moved");
    let mut files = files(&folder).expect("writable");
    files.write(b"first block").expect("room");
    fs::remove_file(folder.join("live.1.pcapng")).expect("put aside");
    files
        .write(b"second block")
        .expect("the file to delete is gone");
    fs::remove_file(folder.join("live.pcapng")).expect("the one that is written");
    files
        .write(b"third block")
        .expect("the file to put aside is gone");
    assert_eq!(names(&folder), ["live.pcapng"]);
    files.write(b"fourth block").expect("it goes on");
    assert_eq!(names(&folder), ["live.4.pcapng", "live.pcapng"]);
    fs::remove_dir_all(folder).expect("ours");
}

/// A restarted rig continues the numbers and overwrites nothing.
#[test]
fn a_recording_of_the_same_name_keeps_what_is_there() {
    let folder = folder("again");
    drop(files(&folder).expect("writable"));
    fs::write(folder.join("live.7.pcapng"), "kept").expect("writable");
    fs::write(folder.join("other.9.pcapng"), "another's").expect("writable");
    drop(files(&folder).expect("writable"));
    let expected = [
        "live.7.pcapng",
        "live.8.pcapng",
        "live.pcapng",
        "other.9.pcapng",
    ];
    assert_eq!(names(&folder), expected);
    assert_eq!(
        fs::read(folder.join("live.8.pcapng")).expect("there"),
        head()
    );
    fs::remove_dir_all(folder).expect("ours");
}

#[test]
fn a_file_that_is_no_capture_is_left_alone() {
    let folder = folder("foreign");
    fs::write(folder.join("live.pcapng"), "my thesis").expect("writable");
    let error = files(&folder).expect_err("not ours");
    assert_eq!(
        error.to_string(),
        "the existing file is not a capture, expected a capture or a free name"
    );
    assert_eq!(names(&folder), ["live.pcapng"]);
    fs::remove_dir_all(folder).expect("ours");
}

/// A process that reserves a name, or is killed before the first byte, leaves an empty file. The
/// recording overwrites this file and uses no number for it.
#[test]
fn an_empty_file_of_the_same_name_is_written_over() {
    let folder = folder("empty");
    fs::write(folder.join("live.pcapng"), "").expect("writable");
    drop(files(&folder).expect("nothing is lost"));
    assert_eq!(names(&folder), ["live.pcapng"]);
    let path = folder.join("live.pcapng");
    assert_eq!(fs::read(path).expect("there"), head());
    fs::remove_dir_all(folder).expect("ours");
}

/// A name may hold any number, also the largest possible one, and a folder may have such a name.
#[test]
fn the_files_around_one_are_told_whatever_their_names() {
    let folder = folder("around");
    let last = folder.join(format!("live.{}.pcapng", u64::MAX));
    let newest = folder.join("live.pcapng");
    fs::create_dir(&last).expect("writable");
    assert_eq!(around(&newest), (vec![newest.clone()], 0));
    fs::remove_dir(&last).expect("ours");
    fs::write(&last, "").expect("writable");
    assert_eq!(around(&last), (vec![last.clone()], 0));
    fs::write(&newest, "").expect("writable");
    assert_eq!(around(&last), (vec![last.clone(), newest.clone()], 0));
    assert_eq!(around(&newest), (vec![last, newest], 1));
    for name in ["live.01.pcapng", "live.1.bin", "live.-1.pcapng"] {
        let path = folder.join(name);
        assert_eq!(around(&path), (vec![path.clone()], 0), "{name}");
    }
    fs::remove_dir_all(folder).expect("ours");
}
