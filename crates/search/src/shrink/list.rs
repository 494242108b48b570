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
    while left.len() > 1 {
        let size = left.len().div_ceil(parts);
        let mut smaller = None;
        // Tries each part alone first, which is fast if it succeeds, then removes each part.
        for start in (0..left.len()).step_by(size) {
            let end = (start + size).min(left.len());
            let only = left[start..end].to_vec();
            if parts == 2 && effort.spend() && fails(&only) {
                smaller = Some((only, 2));
                break;
            }
        }
        for start in (0..left.len()).step_by(size) {
            if smaller.is_some() {
                break;
            }
            let end = (start + size).min(left.len());
            let without = [&left[..start], &left[end..]].concat();
            if effort.spend() && fails(&without) {
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
