//! `hilrig map diff` from the user's side.

use crate::command::{Session, text};

/// A room of 2 m x 1.2 m in cells of 50 mm, in the map server's format. `corner` is its offset from
/// the picture's corner, in cells.
fn room(session: &Session, name: &str, corner: [usize; 2]) {
    let mut gray = String::from("P2\n60 60\n255\n");
    for y in (0..60_usize).rev() {
        for x in 0..60_usize {
            let (x, y) = (x.wrapping_sub(corner[0]), y.wrapping_sub(corner[1]));
            let value = match (x, y) {
                (0 | 40, 0..=24) | (0..=40, 0 | 24) => "0 ",
                (1..40, 1..24) => "254 ",
                _ => "205 ",
            };
            gray.push_str(value);
        }
        gray.push('\n');
    }
    session.write(&format!("{name}.pgm"), gray.as_bytes());
    let yaml = format!("image: {name}.pgm\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n");
    session.write(&format!("{name}.yaml"), yaml.as_bytes());
}

/// The map is shifted three cells of 50 mm to the right: aligned by 150 mm, it is equal.
#[test]
fn a_shifted_map_is_laid_back_and_passes() {
    let session = Session::new("diff");
    room(&session, "a", [8, 10]);
    room(&session, "b", [11, 10]);
    let output = session.hilrig(&[
        "map",
        "diff",
        "a.yaml",
        "b.yaml",
        "--wall-mm-max",
        "5",
        "--overlap-min",
        "0.99",
        "--picture",
        "diff.png",
    ]);
    let said = text(&output.stdout);
    assert_eq!(
        output.status.code(),
        Some(0),
        "{said}{}",
        text(&output.stderr)
    );
    assert!(said.starts_with("B moved by -150.0 mm, 0.0 mm"), "{said}");
    assert!(session.has("diff.png"));
}

/// Without alignment, walls three cells apart have no counterpart within 100 mm.
#[test]
fn maps_that_lie_apart_fail_where_they_must_not() {
    let session = Session::new("diff-apart");
    room(&session, "a", [8, 10]);
    room(&session, "b", [11, 10]);
    let output = session.hilrig(&[
        "map",
        "diff",
        "a.yaml",
        "b.yaml",
        "--reach-m",
        "0",
        "--overlap-min",
        "0.9",
    ]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stdout).contains("FAIL overlap"));
}

#[test]
fn what_is_no_map_is_refused_by_name() {
    let session = Session::new("diff-none");
    room(&session, "a", [8, 10]);
    session.write("bad.yaml", b"image: a.pgm\nresolution: much\n");
    session.write("short.pgm", b"P2\n60 60\n255\n1 2 3\n");
    session.write("short.yaml", b"image: short.pgm\nresolution: 0.05\n");
    let said = |second: &str, more: &[&str]| {
        let output = session.hilrig(&[&["map", "diff", "a.yaml", second], more].concat());
        assert_eq!(output.status.code(), Some(2));
        text(&output.stderr).to_owned()
    };
    let bad = said("bad.yaml", &[]);
    assert!(
        bad.starts_with("error: bad.yaml: line 2: resolution is \"much\""),
        "{bad}"
    );
    let short = said("short.yaml", &[]);
    assert!(
        short.starts_with("error: short.pgm: is no picture"),
        "{short}"
    );
    assert!(said("missing.yaml", &[]).starts_with("error: missing.yaml: cannot be read"));
    assert!(said("a.yaml", &["--reach-m", "99"]).contains("--reach-m 99: expected 0 to 10"));
}
