//! Names of fields of which several have the same.

use std::collections::HashSet;

/// Appends to names that others before them have their own place among all, counted from 0.
pub(super) fn tell_apart(names: &mut [String]) {
    let mut known: HashSet<_> = names.iter().cloned().collect();
    let mut seen = HashSet::new();
    for (n, name) in names.iter_mut().enumerate() {
        if !seen.insert(name.clone()) {
            name.push_str(&format!(".{n}"));
            while !known.insert(name.clone()) {
                name.push('+');
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_names_are_told_apart() {
        let mut names = ["rho", "T", "rho", "rho.2", "rho", "T"].map(str::to_owned);
        tell_apart(&mut names);
        assert_eq!(names, ["rho", "T", "rho.2+", "rho.2", "rho.4", "T.5"]);
    }
}
