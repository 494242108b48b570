//! Extent of a test: its first cases at each landing, all of them with `tests/run.sh --all`, which
//! sets `HILRIG_TESTS=all`.

#![allow(dead_code, reason = "each test binary uses its part")]

/// Whether all cases are to be run.
pub(crate) fn is_thorough() -> bool {
    std::env::var_os("HILRIG_TESTS").is_some_and(|tests| tests == "all")
}

/// The first `few` of `all`, or all of them.
pub(crate) fn few<T>(few: usize, all: impl IntoIterator<Item = T>) -> Vec<T> {
    let most = if is_thorough() { usize::MAX } else { few };
    all.into_iter().take(most).collect()
}

/// Every `step`th of `all` from `first` on, or all of them. Tests over the same list that begin at
/// different places cover it together.
pub(crate) fn every<T>(
    step: usize,
    first: usize,
    all: impl IntoIterator<Item = T>,
) -> impl Iterator<Item = T> {
    let (step, first) = if is_thorough() { (1, 0) } else { (step, first) };
    all.into_iter().skip(first).step_by(step)
}

/// An eighth of `all` generated cases, or all of them.
pub(crate) fn cases(all: u32) -> proptest::test_runner::Config {
    let cases = if is_thorough() { all } else { all.div_ceil(8) };
    proptest::test_runner::Config::with_cases(cases)
}
