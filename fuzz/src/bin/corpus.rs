//! The corpus, readable in `tests/corpus`, and as a coverage-guided fuzzer wants it.
//!
//! ```text
//! corpus replay DIR         every stream of DIR/TARGET/*.txt through its target
//! corpus pack DIR OUT       readable streams to a fuzzer's data, OUT/TARGET/*
//! corpus unpack TARGET DIR OUT   a fuzzer's data to readable streams
//! ```

use std::fs;
use std::path::{Path, PathBuf};

use hilrig_fuzz::codec;
use hilrig_fuzz::codec::wire::Stream;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["replay", dir] => println!("{} streams hold", replay(Path::new(dir))),
        ["pack", dir, out] => pack(Path::new(dir), Path::new(out)),
        ["unpack", target, dir, out] => unpack(target, Path::new(dir), Path::new(out)),
        _ => {
            eprintln!("expected replay DIR, pack DIR OUT or unpack TARGET DIR OUT");
            std::process::exit(2);
        }
    }
}

fn files(dir: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(dir).unwrap_or_else(|error| panic!("{}: {error}", dir.display()));
    let mut files: Vec<_> = entries
        .map(|entry| entry.expect("readable").path())
        .collect();
    files.sort();
    files
}

fn read(path: &Path) -> Stream {
    let text = fs::read_to_string(path).unwrap_or_else(|error| panic!("{path:?}: {error}"));
    Stream::parse(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn replay(dir: &Path) -> usize {
    let mut count = 0;
    for target in codec::targets() {
        for path in files(&dir.join(target.name)) {
            let held = (target.check)(&read(&path));
            held.unwrap_or_else(|broken| panic!("{}: {broken}", path.display()));
            count += 1;
        }
    }
    count
}

fn pack(dir: &Path, out: &Path) {
    for target in codec::targets() {
        let to = out.join(target.name);
        fs::create_dir_all(&to).expect("can be made");
        for path in files(&dir.join(target.name)) {
            let stream = read(&path);
            let data = target.data_of(&stream);
            fs::write(to.join(path.file_stem().expect("a name")), data).expect("can be written");
        }
    }
}

fn unpack(target: &str, dir: &Path, out: &Path) {
    let target = codec::target(target).expect("a target");
    fs::create_dir_all(out).expect("can be made");
    for path in files(dir) {
        let stream = (target.stream)(&fs::read(&path).expect("readable"));
        let name = format!(
            "{}.txt",
            path.file_name().expect("a name").to_string_lossy()
        );
        fs::write(out.join(name), stream.to_text()).expect("can be written");
    }
}
