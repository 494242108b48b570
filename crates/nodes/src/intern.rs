//! Names from node programs with a static lifetime, because rules in logs and names of faults are
//! `'static` everywhere.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

static NAMES: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());

/// Maximum number of names of all node programs.
const NAMES_MAX: usize = 4_096;

/// `name` with a static lifetime. If there are too many names, all further ones share one name.
pub fn forever(name: &str) -> &'static str {
    let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = names.get(name) {
        return known;
    }
    if names.len() >= NAMES_MAX {
        return "one-name-too-many";
    }
    let name: &'static str = Box::leak(name.to_owned().into_boxed_str());
    names.insert(name);
    name
}

static LISTS: Mutex<BTreeSet<&'static [&'static str]>> = Mutex::new(BTreeSet::new());

/// A list of such names with a static lifetime.
pub(crate) fn list_forever(list: Vec<&'static str>) -> &'static [&'static str] {
    let mut lists = LISTS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = lists.get(&list[..]) {
        return known;
    }
    if lists.len() >= NAMES_MAX {
        return &[];
    }
    let list: &'static [&'static str] = Vec::leak(list);
    lists.insert(list);
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_kept_once() {
        let [one, other] = ["tare-lost", "tare-lost"].map(forever);
        assert_eq!(one, "tare-lost");
        assert!(core::ptr::eq(one, other));
    }
}
