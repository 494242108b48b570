//! No command overwrites its own input.

use std::fs;
use std::os::unix::fs::symlink;

use super::{Session, text};

#[test]
fn an_output_that_is_an_input_is_refused_and_stays() {
    let session = Session::new("outputs");
    session.write("in.log", "kept\n");
    fs::create_dir(session.path("run")).expect("the target folder can be written");
    session.write("run/capture.pcapng", "kept\n");
    symlink("in.log", session.path("link")).expect("a link");
    fs::hard_link(session.path("in.log"), session.path("second")).expect("a second name");
    for (line, expected) in [
        (
            "import in.log -o in.log",
            "in.log is an input of this command; choose another name with -o",
        ),
        (
            "import in.log -o ./run/../in.log",
            "choose another name with -o",
        ),
        ("import in.log -o link", "link is an input"),
        ("import link -o in.log", "in.log is an input"),
        ("import in.log -o second", "second is an input"),
        ("export in.log -o in.log --format csv", "with -o"),
        ("export run -o run/capture.pcapng --format csv", "with -o"),
        ("export run -o in.log --scenario in.log", "with -o"),
        ("case from in.log -o in.log", "with -o"),
        ("case from in.log --test in.log", "with --test"),
        ("case from run --exec ./in.log -o in.log", "with -o"),
        ("learn in.log -o in.log", "with -o"),
        ("run in.log --junit in.log", "with --junit"),
        (
            "run run/../in.log --exec : --virtual --trace-calls in.log",
            "with --trace-calls",
        ),
        ("up in.log --case in.log", "with --case"),
        (
            "shrink run/capture.pcapng --while false --out run",
            "with --out",
        ),
        ("replay run/capture.pcapng --exec : --out run", "with --out"),
        ("map diff run in.log --picture in.log", "with --picture"),
    ] {
        let output = session.hilrig(&line.split(' ').collect::<Vec<_>>());
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        assert!(
            said.contains(expected) && said.contains("input of"),
            "{line}: {said}"
        );
        for file in ["in.log", "run/capture.pcapng"] {
            assert_eq!(session.read(file), "kept\n", "{line}");
        }
    }
}
