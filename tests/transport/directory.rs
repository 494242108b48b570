//! Names of ports: they appear, they go, and a name of another program is left alone.

use std::fs;
use std::os::unix::fs::symlink;

use hilrig::realtime::transport::{Note, PortDir, Pty, Transport, TransportError};

use crate::support::*;

#[test]
fn a_name_leads_to_a_terminal_and_goes_with_it() {
    let path = fresh_path("goes_with_it");
    let dir = PortDir::open(&path).expect("a fresh directory");
    let port = Pty::open(&dir, "lidar", LINE).expect("a free name");
    assert_eq!(port.path(), path.join("lidar"));
    let target = fs::read_link(path.join("lidar")).expect("a link");
    assert!(target.starts_with("/dev/pts"));

    drop(port);
    assert!(fs::symlink_metadata(path.join("lidar")).is_err());
    drop(dir);
    assert!(!path.exists(), "what the rig made, it removes");
}

#[test]
fn a_directory_with_other_things_in_it_stays() {
    let path = fresh_path("other_things");
    fs::create_dir_all(&path).expect("writable");
    fs::write(path.join("notes"), "mine").expect("writable");
    let dir = PortDir::open(&path).expect("free");
    drop(Pty::open(&dir, "lidar", LINE).expect("a free name"));
    drop(dir);
    let left: Vec<_> = fs::read_dir(&path).expect("there").collect();
    assert_eq!(left.len(), 1);
}

#[test]
fn nothing_that_is_not_ours_is_overwritten() {
    let path = fresh_path("not_ours");
    fs::create_dir_all(&path).expect("writable");
    fs::write(path.join("lidar"), "mine").expect("writable");
    symlink("/dev/pts/999999", path.join("base")).expect("writable");
    let dir = PortDir::open(&path).expect("free");

    let on_file = Pty::open(&dir, "lidar", LINE).expect_err("a file is in the way");
    let on_link = Pty::open(&dir, "base", LINE).expect_err("a foreign link is in the way");
    assert_eq!(
        on_file.to_string(),
        format!(
            "{}/lidar: expected a free name: this is not a link that a rig left behind; \
             remove it or choose another directory",
            path.display()
        )
    );
    assert!(on_link.to_string().contains("base: expected a free name"));
    assert_eq!(
        fs::read_to_string(path.join("lidar")).expect("there"),
        "mine"
    );
    assert!(fs::symlink_metadata(path.join("base")).is_ok());
}

/// A killed rig removes nothing. Its process numbers are soon used again, so a link that looks
/// alive proves nothing; the record left by the rig names its owner.
#[test]
fn links_of_a_killed_rig_are_replaced() {
    let path = fresh_path("killed_rig");
    fs::create_dir_all(&path).expect("writable");
    symlink("/dev/pts/999999", path.join("lidar")).expect("writable");
    symlink("/dev/pts/999998", path.join("gone")).expect("writable");
    fs::write(
        path.join(".hilrig-ports"),
        "lidar /dev/pts/999999\ngone /dev/pts/999998\n",
    )
    .expect("writable");

    let dir = PortDir::open(&path).expect("its owner is dead");
    let port = Pty::open(&dir, "lidar", LINE).expect("the link is dead");
    drop(client(&port, LINE.baud));
    drop(port);
    drop(dir);
    let left: Vec<_> = fs::read_dir(&path).expect("there").collect();
    assert!(left.is_empty(), "dead links go too: {left:?}");
}

/// A directory in which a link stands at `name`, and the foreign file that it leads to.
fn trapped_dir(name: &str, link: &str) -> (std::path::PathBuf, std::path::PathBuf) {
    let path = fresh_path(name);
    fs::create_dir_all(&path).expect("writable");
    let victim = fresh_path(&format!("{name}_victim"));
    fs::write(&victim, "precious").expect("writable");
    symlink(&victim, path.join(link)).expect("writable");
    (path, victim)
}

fn assert_untouched(victim: &std::path::Path, error: &TransportError, link: &str) {
    let text = error.to_string();
    assert!(
        text.contains(&format!("/{link}: expected a file of hilrig's or nothing")),
        "{text}"
    );
    assert_eq!(fs::read_to_string(victim).expect("there"), "precious");
    fs::remove_file(victim).expect("ours");
}

/// Another user may have prepared the directory in which a user with more rights starts a rig.
#[test]
fn a_note_is_not_written_through_a_link() {
    let link = ".hilrig-scenario.toml";
    let (path, victim) = trapped_dir("note_link", link);
    let mut dir = PortDir::open(&path).expect("free");
    let error = dir
        .leave_note(Note::Scenario, "schema = 1")
        .expect_err("a link");
    assert_untouched(&victim, &error, link);
}

/// The same applies to the temporary name of a note.
#[test]
fn a_note_in_the_making_follows_no_link() {
    let (path, victim) = trapped_dir("note_new_link", ".hilrig-scenario.toml.part");
    let mut dir = PortDir::open(&path).expect("free");
    dir.leave_note(Note::Scenario, "schema = 1")
        .expect("the link goes");
    assert_eq!(fs::read_to_string(&victim).expect("there"), "precious");
    let note = fs::read_to_string(path.join(".hilrig-scenario.toml"));
    assert_eq!(note.expect("there"), "schema = 1");
    fs::remove_file(victim).expect("ours");
}

#[test]
fn the_record_is_not_written_through_a_link() {
    let (path, victim) = trapped_dir("record_link", ".hilrig-ports");
    let error = PortDir::open(&path).expect_err("a link");
    assert_untouched(&victim, &error, ".hilrig-ports");
}

/// A second hard link of a file is treated like a symbolic link to it.
#[test]
fn the_record_is_not_written_into_a_file_that_has_another_name_too() {
    let (path, victim) = trapped_dir("record_hard_link", "unused");
    fs::hard_link(&victim, path.join(".hilrig-ports")).expect("the same file system");
    let error = PortDir::open(&path).expect_err("a link");
    assert_untouched(&victim, &error, ".hilrig-ports");
}

/// The note of a killed rig is replaced.
#[test]
fn a_note_that_was_left_behind_is_replaced() {
    let path = fresh_path("old_note");
    fs::create_dir_all(&path).expect("writable");
    let note = path.join(".hilrig-scenario.toml");
    fs::write(&note, "old").expect("writable");
    let mut dir = PortDir::open(&path).expect("free");
    dir.leave_note(Note::Scenario, "new").expect("writable");
    assert_eq!(fs::read_to_string(&note).expect("there"), "new");
    drop(dir);
    let left: Vec<_> = fs::read_dir(&path).expect("there").collect();
    assert!(left.is_empty(), "notes go with the rig: {left:?}");
}

#[test]
fn one_directory_belongs_to_one_rig() {
    let path = fresh_path("one_rig");
    let first = PortDir::open(&path).expect("a fresh directory");
    let second = PortDir::open(&path).expect_err("taken");
    assert_eq!(
        second.to_string(),
        format!(
            "{}: another rig has its ports here: stop it or choose another directory",
            path.display()
        )
    );
    drop(first);
    assert!(PortDir::open(&path).is_ok());
}

#[test]
fn two_rigs_in_two_directories_share_names_and_nothing_else() {
    let (dir_a, dir_b) = (fresh_dir("two_rigs_a"), fresh_dir("two_rigs_b"));
    let mut a = Pty::open(&dir_a, "lidar", LINE).expect("a free name");
    let mut b = Pty::open(&dir_b, "lidar", LINE).expect("a free name");
    let (mut client_a, mut client_b) = (client(&a, LINE.baud), client(&b, LINE.baud));
    assert_eq!(a.write(b"from a"), 6);
    assert_eq!(b.write(b"from b"), 6);
    assert_eq!(client_gets(&mut client_a, 6), b"from a");
    assert_eq!(client_gets(&mut client_b, 6), b"from b");
}

#[test]
fn a_name_with_a_slash_is_refused() {
    let dir = fresh_dir("slash");
    let error = Pty::open(&dir, "../lidar", LINE).expect_err("leads elsewhere");
    assert_eq!(
        error.to_string(),
        r#"port name "../lidar": expected a plain file name such as lidar"#
    );
}

#[test]
fn a_directory_that_cannot_be_is_named() {
    let error = PortDir::open("/dev/null/ports".as_ref()).expect_err("no directory");
    assert!(
        error
            .to_string()
            .starts_with("/dev/null/ports: expected a directory to put ports in: "),
        "{error}"
    );
}
