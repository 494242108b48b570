//! Tests with folders that another user prepared: whatever the entry is, nothing outside changes.

use std::fs;
use std::io::Write as _;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};

use crate::Dir;

/// A test folder with `out` as the target folder and `victim`, which must stay unchanged.
struct Trap(PathBuf);

impl Trap {
    fn new(name: &str) -> Self {
        let path =
            std::env::temp_dir().join(format!("hilrig-safefs-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(path.join("out")).expect("a free name");
        fs::create_dir(path.join("folder")).expect("a free name");
        fs::write(path.join("victim"), "precious").expect("can be written");
        fs::write(path.join("folder/a"), "precious").expect("can be written");
        Self(path)
    }

    fn out(&self) -> PathBuf {
        self.0.join("out")
    }

    fn victim(&self) -> PathBuf {
        self.0.join("victim")
    }

    fn assert_whole(&self) {
        assert_eq!(fs::read(self.victim()).expect("is there"), b"precious");
        let folder = self.0.join("folder");
        assert_eq!(fs::read(folder.join("a")).expect("is there"), b"precious");
        assert_eq!(fs::read_dir(folder).expect("is there").count(), 1);
    }
}

impl Drop for Trap {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn pipe(path: &Path) {
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a free name");
}

/// Creates an entry of each kind at `path`.
fn prepare(trap: &Trap, path: &Path, kind: &str) {
    match kind {
        "link" => symlink(trap.victim(), path),
        "dangling link" => symlink(trap.0.join("folder/new"), path),
        "hard link" => fs::hard_link(trap.victim(), path),
        "pipe" => {
            pipe(path);
            Ok(())
        }
        _ => Ok(()),
    }
    .expect("a free name");
}

const KINDS: [&str; 5] = ["nothing", "link", "dangling link", "hard link", "pipe"];

#[test]
fn a_new_file_replaces_whatever_has_its_name() {
    for kind in KINDS {
        for which in ["whole", "stream", "stale part"] {
            let trap = Trap::new(&format!("new-{which}-{kind}").replace(' ', "-"));
            let dir = Dir::open(&trap.out()).expect("is there");
            let prepared = if which == "stale part" { "a.part" } else { "a" };
            prepare(&trap, &trap.out().join(prepared), kind);
            match which {
                "stream" => {
                    let mut file = dir.create_file("a").expect("a name of ours");
                    file.write_all(b"new").expect("there is room");
                }
                _ => dir.write("a", "new").expect("a name of ours"),
            }
            assert_eq!(fs::read(trap.out().join("a")).expect("is there"), b"new");
            assert!(!trap.out().join("a").is_symlink(), "{which} {kind}");
            assert_eq!(dir.names().expect("can be listed"), ["a"]);
            trap.assert_whole();
        }
    }
}

#[test]
fn a_file_that_is_appended_to_is_a_file_of_its_own() {
    for kind in KINDS {
        let trap = Trap::new(&format!("append-{kind}").replace(' ', "-"));
        let dir = Dir::open(&trap.out()).expect("is there");
        prepare(&trap, &trap.out().join("a"), kind);
        assert_eq!(dir.append("a").is_ok(), kind == "nothing", "{kind}");
        assert_eq!(dir.open_or_create("a").is_ok(), kind == "nothing", "{kind}");
        assert_eq!(
            dir.read("a", 8).is_ok(),
            ["nothing", "hard link"].contains(&kind)
        );
        trap.assert_whole();
    }
}

#[test]
fn no_folder_is_reached_through_a_link() {
    let trap = Trap::new("folders");
    let target = trap.0.join("folder");
    symlink(&target, trap.out().join("sub")).expect("a free name");
    symlink(&target, trap.0.join("other")).expect("a free name");
    let dir = Dir::open(&trap.out()).expect("is there");
    let error = dir.write("sub/a", "new").expect_err("a link").to_string();
    assert!(error.contains(&target.display().to_string()), "{error}");
    assert!(dir.create_file("sub/b").is_err());
    assert!(dir.append("sub/a").is_err());
    assert!(dir.remove_file("sub/a").is_err());
    assert!(dir.rename("sub/a", "a").is_err());
    assert!(dir.below("sub").is_err() && dir.below("sub/x").is_err());
    assert!(Dir::create(&trap.0.join("other")).is_err());
    assert!(Dir::create(&trap.0.join("other/")).is_err());
    // An ancestor that the user named is followed.
    assert!(Dir::open(&trap.0.join("other/.")).is_err());
    fs::create_dir(target.join("deep")).expect("a free name");
    assert!(Dir::open(&trap.0.join("other/deep")).is_ok());
    fs::remove_dir(target.join("deep")).expect("is empty");
    dir.remove_tree("sub").expect("the link goes");
    assert!(!trap.out().join("sub").is_symlink());
    trap.assert_whole();
}

#[test]
fn names_that_were_read_lead_nowhere_else() {
    let trap = Trap::new("names");
    let dir = Dir::open(&trap.out()).expect("is there");
    let absolute = trap.victim().display().to_string();
    for name in [
        &*absolute,
        "../victim",
        "x/../../victim",
        "..",
        ".",
        "",
        "/",
    ] {
        assert!(dir.write(name, "new").is_err(), "{name}");
        assert!(dir.create_file(name).is_err(), "{name}");
        assert!(dir.append(name).is_err(), "{name}");
        assert!(dir.remove_file(name).is_err(), "{name}");
        assert!(dir.remove_tree(name).is_err(), "{name}");
        assert!(dir.link(name, Path::new("x")).is_err(), "{name}");
        assert!(dir.read_link(name).is_err(), "{name}");
        assert!(dir.listen(name).is_err(), "{name}");
    }
    trap.assert_whole();
}

#[test]
fn a_tree_is_removed_and_its_links_go_themselves() {
    let trap = Trap::new("tree");
    let dir = Dir::open(&trap.out()).expect("is there");
    dir.write("t/deep/a", "x").expect("a name of ours");
    symlink(trap.0.join("folder"), trap.out().join("t/deep/link")).expect("a free name");
    dir.remove_tree("t").expect("ours");
    assert!(dir.names().expect("can be listed").is_empty());
    trap.assert_whole();
}

#[test]
fn an_error_leaves_the_earlier_file_and_nothing_beside_it() {
    let trap = Trap::new("whole");
    let dir = Dir::open(&trap.out()).expect("is there");
    dir.write("a", "one").expect("there is room");
    fs::create_dir(trap.out().join("a.part")).expect("can be made");
    assert!(dir.write("a", "two").is_err());
    fs::remove_dir(trap.out().join("a.part")).expect("is empty");
    let full = dir.write_with("a", |_| Err(std::io::ErrorKind::StorageFull.into()));
    assert!(full.is_err());
    assert_eq!(fs::read(trap.out().join("a")).expect("is there"), b"one");
    assert_eq!(dir.names().expect("can be listed"), ["a"]);
    assert!(dir.write("a/b", "no folder").is_err());
}

#[test]
fn a_name_that_the_user_gives_is_replaced_unless_it_is_a_device() {
    let trap = Trap::new("named");
    let link = trap.out().join("link");
    symlink(trap.victim(), &link).expect("a free name");
    crate::write(&link, "new").expect("a name of ours");
    assert!(!link.is_symlink());
    fs::remove_file(&link).expect("ours");
    symlink(trap.victim(), &link).expect("a free name");
    crate::create(&link).expect("a name of ours");
    assert!(!link.is_symlink());
    trap.assert_whole();
    assert!(crate::write(Path::new("/dev/full"), "two").is_err());
    crate::write(Path::new("/dev/null"), "two").expect("takes everything");
    crate::write(Path::new("/dev/stdout"), "").expect("our own");
    assert!(Path::new("/dev/full").exists() && Path::new("/dev/null").exists());
}

#[test]
fn a_pipe_that_is_read_is_written_to() {
    let trap = Trap::new("pipe");
    let path = trap.out().join("pipe");
    pipe(&path);
    let reader = {
        let path = path.clone();
        std::thread::spawn(move || fs::read(path))
    };
    crate::write(&path, "through").expect("it is read");
    let read = reader.join().expect("no panic").expect("a pipe");
    assert_eq!(read, b"through");
}

#[test]
fn a_socket_is_for_its_owner_alone() {
    let trap = Trap::new("socket");
    let dir = Dir::open(&trap.out()).expect("is there");
    // The umask belongs to the whole process: other tests create files at the same time.
    let listener = dir.listen("control").expect("a free name");
    let mode = fs::metadata(trap.out().join("control")).expect("is there");
    assert_eq!(mode.permissions().mode() & 0o777, 0o600);
    assert!(dir.is_socket("control") && !dir.is_socket("other"));
    std::os::unix::net::UnixStream::connect(trap.out().join("control")).expect("we may");
    listener.accept().expect("it came");
    let taken = dir.listen("control").expect_err("is taken").kind();
    assert_eq!(taken, std::io::ErrorKind::AddrInUse);
}

/// No entry in the place of a file holds a reader up: a pipe has no writer here.
#[test]
fn only_plain_files_are_read() {
    let trap = Trap::new("read");
    let read = |name: &str| crate::read_text(&trap.0.join(name));
    assert_eq!(read("victim").expect("a plain file"), "precious");
    symlink(trap.victim(), trap.0.join("link")).expect("a free name");
    assert_eq!(read("link").expect("a plain file"), "precious");
    pipe(&trap.0.join("pipe"));
    symlink(trap.0.join("pipe"), trap.0.join("link to a pipe")).expect("a free name");
    symlink("/dev/zero", trap.0.join("link to a device")).expect("a free name");
    for name in ["pipe", "link to a pipe", "link to a device", "folder"] {
        let error = read(name).expect_err("no plain file");
        assert_eq!(error.to_string(), "is not a file", "{name}");
    }
    assert_eq!(
        read("missing").expect_err("missing").kind(),
        std::io::ErrorKind::NotFound
    );
}
