use super::Effort;

/// The smallest list of `items`, in order, for which `fails` still returns true (Zeller's delta
/// debugging). No single remaining item can be removed, unless the effort was used up.
///
/// `fails` must return true for all of `items`.
pub fn fewest<T: Clone>(
    items: &[T],
    effort: &mut Effort<'_>,
    mut fails: impl FnMut(&[T]) -> bool,
) -> Vec<T> {
    let mut left = items.to_vec();
    if left.is_empty() || (effort.spend() && fails(&[])) {
        return Vec::new();
    }
    let mut parts = 2;
    while left.len() > 1 && effort.is_left() {
        let size = left.len().div_ceil(parts);
        let mut smaller = None;
        // Tries each part alone first, which is fast if it succeeds, then removes each part.
        for start in (0..left.len()).step_by(size) {
            if parts > 2 || !effort.spend() {
                break;
            }
            let end = (start + size).min(left.len());
            let only = left[start..end].to_vec();
            if fails(&only) {
                smaller = Some((only, 2));
                break;
            }
        }
        for start in (0..left.len()).step_by(size) {
            if smaller.is_some() || !effort.spend() {
                break;
            }
            let end = (start + size).min(left.len());
            let without = [&left[..start], &left[end..]].concat();
            if fails(&without) {
                smaller = Some((without, parts.saturating_sub(1).max(2)));
            }
        }
        match smaller {
            Some((fewer, finer)) => (left, parts) = (fewer, finer),
            None if size == 1 => break,
            None => parts = (parts * 2).min(left.len()),
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use core::cell::Cell;
    use std::rc::Rc;

    use super::*;

    /// The items 3 and 77 are necessary, the other 98 are not.
    #[test]
    fn two_of_a_hundred_are_found() {
        let items: Vec<u32> = (0..100).collect();
        let mut effort = Effort::tries(1000);
        let both = |left: &[u32]| left.contains(&3) && left.contains(&77);
        assert_eq!(fewest(&items, &mut effort, both), [3, 77]);
        assert!(effort.spent() < 100, "{effort:?}");
    }

    /// An item that counts its copies.
    struct Counted(Rc<Cell<u32>>);

    impl Clone for Counted {
        fn clone(&self) -> Self {
            self.0.set(self.0.get() + 1);
            Self(Rc::clone(&self.0))
        }
    }

    /// With two tries left, a list of 10,000 is copied for these tries, and not once for each item.
    #[test]
    fn without_effort_nothing_is_copied() {
        let copies = Rc::new(Cell::new(0));
        let items: Vec<Counted> = (0..10_000).map(|_| Counted(Rc::clone(&copies))).collect();
        let left = fewest(&items, &mut Effort::tries(2), |_| false);
        assert_eq!((left.len(), copies.get() < 30_000), (10_000, true));
    }

    #[test]
    fn nothing_is_left_if_nothing_matters() {
        assert!(fewest(&[1, 2], &mut Effort::tries(9), |_| true).is_empty());
    }

    /// When the effort is used up, the remaining list still fails.
    #[test]
    fn the_best_so_far_still_fails() {
        let items: Vec<u32> = (0..64).collect();
        for most in 0..20 {
            let both = |left: &[u32]| left.contains(&3) && left.contains(&60);
            let left = fewest(&items, &mut Effort::tries(most), both);
            assert!(both(&left), "{most}: {left:?}");
        }
    }
}
