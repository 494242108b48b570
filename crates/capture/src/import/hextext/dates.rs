//! Order of day and month in dates such as 11/27/2026, from all dates of a file.

use core::ops::Range;
use std::borrow::Cow;

use crate::import::text::number;

/// A date as written: two numbers and a year.
struct Slashed {
    range: Range<usize>,
    first: u64,
    second: u64,
    year: u64,
}

impl Slashed {
    fn of(text: &str) -> Option<Self> {
        let is_inside = |c: char| c.is_ascii_digit() || c == '/';
        let words = text.split(|c| !is_inside(c));
        words.into_iter().find_map(|word| {
            let mut parts = word.split('/');
            let [first, second, year] = [parts.next()?, parts.next()?, parts.next()?];
            let is_date = first.len() <= 2 && second.len() <= 2 && year.len() == 4;
            let start = word.as_ptr() as usize - text.as_ptr() as usize;
            (is_date && parts.next().is_none()).then_some(Self {
                range: start..start + word.len(),
                first: number(first)?,
                second: number(second)?,
                year: number(year)?,
            })
        })
    }
}

/// The order of the dates of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::import) struct Dates {
    is_month_first: bool,
    /// Whether all dates fit both orders.
    is_unknown: bool,
}

impl Dates {
    /// The order of the dates in `texts`.
    pub(in crate::import) fn of<'a>(texts: impl Iterator<Item = &'a str>) -> Self {
        let (mut count, mut days, mut months) = (0, 0, 0);
        for date in texts.filter_map(Slashed::of) {
            count += 1;
            days += usize::from(date.first > 12);
            months += usize::from(date.second > 12);
        }
        Self {
            is_month_first: months > 0 && days == 0,
            is_unknown: count > 0 && months == 0 && days == 0,
        }
    }

    /// The note about dates that fit both orders.
    pub(in crate::import) fn note(&self) -> Option<String> {
        const DAY_FIRST: &str = "the dates may begin with the day or with the month: they are taken \
                                 as day/month/year";
        self.is_unknown.then(|| DAY_FIRST.to_owned())
    }

    /// The text with its date in the order of ISO 8601 if the month comes first.
    pub(in crate::import) fn told<'a>(&self, text: &'a str) -> Cow<'a, str> {
        let date = Slashed::of(text).filter(|_| self.is_month_first);
        let Some(Slashed {
            range,
            first,
            second,
            year,
        }) = date
        else {
            return Cow::Borrowed(text);
        };
        let iso = format!("{year}-{first:02}-{second:02}");
        Cow::Owned([&text[..range.start], &iso, &text[range.end..]].concat())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_dates_together_tell_the_order() {
        for (texts, expected, is_unknown) in [
            (["11/27/2026 x", "[12/1/2026] x"], "[2026-12-01] x", false),
            (["27/11/2026 x", "1/12/2026 x"], "1/12/2026 x", false),
            (["05/06/2026 x", "06/06/2026 x"], "06/06/2026 x", true),
            (["2026/11/27 x", "2026/12/01 x"], "2026/12/01 x", false),
            (["1/2 x", "AB 24"], "AB 24", false),
        ] {
            let dates = Dates::of(texts.into_iter());
            assert_eq!(dates.told(texts[1]), expected);
            assert_eq!(dates.is_unknown, is_unknown, "{texts:?}");
        }
    }

    /// Two numbers of at most two digits and a year of four, the first ones of a line.
    #[test]
    fn a_date_is_two_short_numbers_and_a_year() {
        let of = |text: &str| {
            let date = Slashed::of(text)?;
            Some((date.range, date.first, date.second, date.year))
        };
        assert_eq!(of("[1/12/2026] x"), Some((1..10, 1, 12, 2_026)));
        assert_eq!(of("a/b 12/11/2026"), Some((4..14, 12, 11, 2_026)));
        for text in [
            "123/1/2026",
            "1/123/2026",
            "1/2/26",
            "1/2/20266",
            "1/2/2026/3",
            "1/2",
            "/1/2026",
            "1//2026",
        ] {
            assert_eq!(of(text), None, "{text}");
        }
    }

    /// 12 may be a month, 13 cannot. One day above 12 in the first place decides for all dates.
    #[test]
    fn a_number_above_twelve_is_a_day() {
        let of = |texts: &[&str]| {
            let dates = Dates::of(texts.iter().copied());
            (dates.is_month_first, dates.note().is_some())
        };
        assert_eq!(of(&["12/12/2026"]), (false, true));
        assert_eq!(of(&["12/13/2026"]), (true, false));
        assert_eq!(of(&["13/12/2026"]), (false, false));
        assert_eq!(of(&["12/13/2026", "13/12/2026"]), (false, false));
        assert_eq!(of(&["x"]), (false, false));
    }
}
