//! Findings of campaigns, minimised: each of them failed once.

use std::path::Path;

use hilrig::run::Run;
use hilrig::scenario::Scenario;

use super::failures;

#[test]
fn what_campaigns_found_does_not_come_back() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/rig/cases");
    let entries = std::fs::read_dir(folder).expect("the folder is part of the repository");
    let mut paths: Vec<_> = entries
        .map(|entry| entry.expect("readable").path())
        .collect();
    paths.sort();
    assert!(!paths.is_empty());
    for path in paths {
        let (scenario, source) = Scenario::read(&path).expect("a case is sound");
        let outcome = Run::new(scenario, &source, None)
            .expect("can be wired")
            .finish();
        assert_eq!(failures(&outcome), [""; 0], "{}", path.display());
    }
}
