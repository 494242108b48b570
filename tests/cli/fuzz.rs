//! `hilrig fuzz`: deterministic, resumable, and with errors that name the expected value.

use super::{Session, text};

fn fuzz(session: &Session, more: &str) -> (Option<i32>, String, String) {
    let arguments = ["fuzz"].into_iter().chain(more.split_whitespace());
    let output = session.hilrig(&arguments.collect::<Vec<_>>());
    let [stdout, stderr] = [&output.stdout, &output.stderr].map(|bytes| text(bytes).to_owned());
    (output.status.code(), stdout, stderr)
}

/// All wire formats, a few thousand cases each: the decoders are sound, so nothing is found.
#[test]
fn the_decoders_are_fuzzed_and_nothing_is_found() {
    let session = Session::new("fuzz-wires");
    let (code, said, errors) = fuzz(&session, "xv11 pcui hc06 --cases 6000 --out all");
    assert_eq!(code, Some(0), "{said}{errors}");
    assert!(said.starts_with("xv11: 6000 cases, "), "{said}");
    assert!(said.ends_with("0 findings, results in all\n"), "{said}");
}

/// Two processors with an interruption at the end of a round, against an uninterrupted run on one.
#[test]
fn the_same_seed_and_cases_leave_the_same_corpus() {
    let session = Session::new("fuzz-same");
    fuzz(&session, "pcui --cases 12288 --jobs 1 --out one");
    fuzz(&session, "pcui --cases 8192 --jobs 2 --out two");
    fuzz(&session, "pcui --cases 12288 --jobs 2 --out two");
    let files = |dir: &str| {
        let folder = session.path(dir).join("corpus/pcui");
        let mut names: Vec<_> = std::fs::read_dir(folder)
            .expect("written")
            .map(|entry| entry.expect("readable").path())
            .collect();
        names.sort();
        let texts = names
            .iter()
            .map(|path| std::fs::read_to_string(path).expect("text"));
        texts.collect::<Vec<_>>()
    };
    let (one, two) = (files("one"), files("two"));
    assert!(one.len() > 20, "{} kept", one.len());
    assert_eq!(one, two);
    assert_eq!(session.read("one/fuzz.json"), session.read("two/fuzz.json"));
}

#[test]
fn a_corpus_of_readable_streams_is_begun_with() {
    let session = Session::new("fuzz-corpus");
    std::fs::create_dir(session.path("mine")).expect("room");
    session.write("mine/a.txt", "# a read\nAB 24 0A 00 D9\n");
    let (code, said, _) = fuzz(&session, "avr-high-first --corpus mine --cases 1 --out a");
    assert_eq!(code, Some(0), "{said}");
    let corpus = std::fs::read_dir(session.path("a/corpus/avr-high-first")).expect("written");
    let texts: Vec<String> = corpus
        .map(|entry| std::fs::read_to_string(entry.expect("readable").path()).expect("text"))
        .collect();
    let has_it = |text: &String| text.ends_with("\nAB 24 0A 00 D9\n");
    assert!(texts.iter().any(has_it), "{texts:?}");

    session.write("mine/b.txt", "AB 24\nAX\n");
    let (code, _, error) = fuzz(&session, "avr-high-first --corpus mine --cases 1 --out b");
    assert_eq!(code, Some(2));
    assert_eq!(
        error,
        "error: mine/b.txt: line 2: \"AX\", expected hexadecimal pairs or \"idle\"\n"
    );
}

#[test]
fn a_case_is_repeated_from_its_file_or_folder() {
    let session = Session::new("fuzz-repeat");
    std::fs::create_dir(session.path("finding")).expect("room");
    session.write("finding/stream.txt", "50 43\nidle\n");
    for file in ["finding", "finding/stream.txt"] {
        let (code, said, _) = fuzz(&session, &format!("pcui --repeat {file}"));
        assert_eq!((code, &*said), (Some(0), "pcui: every law holds\n"));
    }
    let (code, _, error) = fuzz(&session, "pcui --repeat nowhere.txt");
    assert_eq!(code, Some(2));
    assert_eq!(
        error,
        "error: cannot read nowhere.txt: No such file or directory (os error 2)\n"
    );
}

/// Acknowledgements count as data: found within the first cases, minimised, and reproduced by the
/// printed command. The same command finds nothing in the correct program.
#[test]
fn a_known_defect_is_found_and_repeated() {
    let session = Session::new("fuzz-defect");
    let (code, said, errors) = fuzz(&session, "--defect MA-05 --cases 256 --out found");
    assert_eq!(code, Some(1), "{said}{errors}");
    assert!(
        said.starts_with("rescue: an-answer-fits-its-question: a read\n"),
        "{said}"
    );
    let command = said
        .lines()
        .find_map(|line| line.split_once("repeat with: hilrig "));
    let command: Vec<&str> = command.expect("told").1.split(' ').collect();
    let again = session.hilrig(&command);
    assert_eq!(again.status.code(), Some(1), "{}", text(&again.stderr));
    let file = command.last().expect("the file");
    assert_eq!(session.read(file), "reply acknowledged\n");
    let sound = session.hilrig(&["fuzz", "rescue", "--repeat", file]);
    assert_eq!(text(&sound.stdout), "rescue: every law holds\n");
    let capture = session.path(file).with_file_name("capture.pcapng");
    let capture = capture::Capture::read(&capture).expect("written");
    assert!(capture.records.len() > 4, "{}", capture.records.len());
}

#[test]
fn what_cannot_be_fuzzed_is_told_with_what_can() {
    let session = Session::new("fuzz-errors");
    let (code, _, error) = fuzz(&session, "xv12");
    assert_eq!(code, Some(2));
    assert!(
        error.starts_with("error: there is no target \"xv12\", expected one of xv11, "),
        "{error}"
    );
    let (code, _, error) = fuzz(&session, "--defect MA-99");
    assert_eq!(code, Some(2));
    assert!(
        error.starts_with("error: --defect MA-99: no program has it, expected"),
        "{error}"
    );
    let (code, _, error) = fuzz(&session, "--link base");
    assert_eq!(code, Some(2));
    assert!(error.contains("--scenario <SCENARIO>"), "{error}");
    session.write("room.toml", &super::shipped("empty-room"));
    let (code, _, error) = fuzz(&session, "--scenario room.toml --link bus");
    assert_eq!(code, Some(2));
    assert_eq!(
        error,
        "error: --link bus: no wire format that can be fuzzed, the links of room.toml are lidar, \
         motor, base, radio, pc\n"
    );
}

#[test]
fn a_folder_of_another_fuzzer_is_refused() {
    let session = Session::new("fuzz-other");
    fuzz(&session, "rle --cases 10 --out one");
    let (code, _, error) = fuzz(&session, "rle --cases 20 --seed 2 --out one");
    assert_eq!(code, Some(2));
    assert!(
        error.contains("one/fuzz.json: is of another run"),
        "{error}"
    );
}

/// A base whose firmware forgets to stop, in a room where this shows within two seconds. The
/// mission cannot be complete by then; this is a finding with a case and a command that reproduces
/// it.
#[test]
fn a_scenario_that_fails_leaves_a_small_case_that_fails() {
    let session = Session::new("fuzz-scenario");
    let scenario = super::shipped("empty-room").replace("\"90s\"", "\"2s\"");
    session.write("short.toml", &scenario);
    let (code, said, errors) = fuzz(
        &session,
        "--scenario short.toml --vary timing --cases 2 --out found",
    );
    assert_eq!(code, Some(1), "{said}{errors}");
    assert!(
        said.starts_with("empty-room: waypoints-visited: "),
        "{said}"
    );
    let command = said
        .lines()
        .find_map(|line| line.split_once("repeat with: hilrig "));
    let (_, command) = command.expect("told");
    let again = session.hilrig(&command.split(' ').collect::<Vec<_>>());
    assert_eq!(again.status.code(), Some(1), "{}", text(&again.stderr));
    assert!(text(&again.stdout).contains("FAIL waypoints-visited"));
}
