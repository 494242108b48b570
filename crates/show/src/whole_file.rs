//! Files that are there as a whole or not at all.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Writes beside `path` and renames: on a full disk, or if the process is killed, there is the
/// earlier file or none, never a torn one. What is no plain file, a pipe for one, is written as it
/// is; a link stays one.
///
/// # Errors
/// What the system says. Then `path` is as it was.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    if fs::metadata(path).is_ok_and(|there| !there.is_file()) {
        return fs::write(path, bytes);
    }
    let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let part = PathBuf::from(part);
    let written = fs::write(&part, bytes).and_then(|()| fs::rename(&part, &path));
    if written.is_err() {
        // It may be that it could not even be made.
        let _ = fs::remove_file(&part);
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder of its own in the system's one for such things.
    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("hilrig-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("can be written");
        folder
    }

    #[test]
    fn what_cannot_be_written_leaves_the_earlier_file_and_nothing_beside_it() {
        let folder = folder("whole");
        let path = folder.join("a");
        write(&path, "one").expect("there is room");
        // A folder has the name of what is written first.
        fs::create_dir(folder.join("a.part")).expect("can be made");
        assert!(write(&path, "two").is_err());
        assert_eq!(fs::read(&path).expect("is there"), b"one");
        fs::remove_dir(folder.join("a.part")).expect("is empty");
        write(&path, "two").expect("there is room");
        assert_eq!(fs::read(&path).expect("is there"), b"two");
        assert_eq!(fs::read_dir(&folder).expect("is there").count(), 1);
        let _ = fs::remove_dir_all(folder);
    }

    #[test]
    fn a_link_stays_a_link_and_a_device_is_written_as_it_is() {
        let folder = folder("link");
        let (file, link) = (folder.join("file"), folder.join("link"));
        fs::write(&file, "one").expect("can be written");
        std::os::unix::fs::symlink(&file, &link).expect("can be made");
        write(&link, "two").expect("there is room");
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).expect("is there"), b"two");
        assert!(write(Path::new("/dev/full"), "two").is_err());
        assert!(Path::new("/dev/full").exists());
        let _ = fs::remove_dir_all(folder);
    }
}
