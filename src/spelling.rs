//! Known words and sizes as error messages spell them.

/// Letters of a word that are compared: enough for any known word, and bounds the time.
const MAX_COMPARED: usize = 64;

/// The word of `known` that takes the fewest edits to reach from `word` (the first of equals).
pub(crate) fn nearest<'k>(word: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    known.into_iter().min_by_key(|candidate| distance(word, candidate))
}

/// The words of `known`, the nearest to `word` first, the others as they come.
pub(crate) fn nearest_first<'k>(
    word: &str,
    known: impl IntoIterator<Item = &'k str>,
) -> Vec<&'k str> {
    let mut words: Vec<&str> = known.into_iter().collect();
    if let Some(first) = nearest(word, words.iter().copied()) {
        words.sort_by_key(|candidate| *candidate != first);
    }
    words
}

/// Which of `known` is `word`: as it stands, else the only one that it is without regard to case.
pub(crate) fn position<'k>(
    word: &str,
    known: impl IntoIterator<Item = &'k str, IntoIter: Clone>,
) -> Option<usize> {
    let known = known.into_iter();
    let exact = known.clone().position(|candidate| candidate == word);
    exact.or_else(|| {
        let mut alike =
            known.enumerate().filter(|(_, candidate)| candidate.eq_ignore_ascii_case(word));
        let (first, _) = alike.next()?;
        alike.next().is_none().then_some(first)
    })
}

/// Edit distance that counts insertions, deletions, replacements and swaps of neighbours, without
/// regard to case (optimal string alignment).
fn distance(a: &str, b: &str) -> usize {
    let letters = |word: &str| -> Vec<char> {
        word.chars().take(MAX_COMPARED).flat_map(char::to_lowercase).collect()
    };
    let (a, b) = (letters(a), letters(b));
    let mut rows: Vec<Vec<usize>> = vec![(0..=b.len()).collect()];
    for i in 1..=a.len() {
        let mut row = vec![i; b.len() + 1];
        for j in 1..=b.len() {
            let replaced = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            row[j] = replaced.min(rows[i - 1][j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                row[j] = row[j].min(rows[i - 2][j - 2] + 1);
            }
        }
        rows.push(row);
    }
    rows[a.len()][b.len()]
}

/// `bytes` as an option takes them, exactly: `64MiB`, `1000B`. No unit is larger, so that limits compare
/// at a glance.
pub(crate) fn size(bytes: u64) -> String {
    let units = [(20, "MiB"), (10, "KiB")];
    let whole = units.into_iter().find(|(power, _)| bytes > 0 && bytes.trailing_zeros() >= *power);
    whole.map_or_else(|| format!("{bytes}B"), |(power, unit)| format!("{}{unit}", bytes >> power))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_by_hand() {
        for (a, b, expected) in [
            ("", "", 0),
            ("", "abc", 3),
            ("toleranse", "tolerance", 1),
            ("widht", "width", 1),
            ("FOV", "fov", 0),
            ("kitten", "sitting", 3),
            ("höhe", "hohe", 1),
        ] {
            assert_eq!(distance(a, b), expected, "{a} {b}");
            assert_eq!(distance(b, a), expected, "{b} {a}");
        }
    }

    #[test]
    fn the_nearest_word_is_named() {
        let known = ["interpolation", "tolerance", "samples", "background"];
        assert_eq!(nearest("sampels", known), Some("samples"));
        assert!(nearest("x".repeat(1_000_000).as_str(), known).is_some());
        assert_eq!(nearest("x", []), None);
        assert_eq!(nearest_first("c", ["a", "bc", "d", "c"]), ["c", "a", "bc", "d"]);
        assert!(nearest_first("c", []).is_empty());
    }

    #[test]
    fn case_decides_only_between_words_that_differ_in_nothing_else() {
        assert_eq!(position("b", ["a", "B", "b"]), Some(2));
        assert_eq!(position("A", ["x", "a"]), Some(1));
        assert_eq!(position("c", ["a", "B"]), None);
        assert_eq!(position("ab", ["aB", "Ab"]), None);
    }

    #[test]
    fn sizes_are_exact() {
        let sizes = [0, 1, 1000, 1 << 10, 3 << 19, (1 << 20) + 1, 1 << 30];
        let spelt = ["0B", "1B", "1000B", "1KiB", "1536KiB", "1048577B", "1024MiB"];
        assert_eq!(sizes.map(size), spelt);
    }
}
