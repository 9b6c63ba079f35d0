//! Processor time of processes that this one has started.

/// Ticks of the system's own clock in a second, as Linux shows them to all programs.
const TICKS: f64 = 100.0;
/// Where the times of ended children stand in the status line, after the name in parentheses.
const CHILDREN: [usize; 2] = [13, 14];

/// What all ended children took so far, of all their threads and the system's work for them,
/// seconds; none where the system does not say.
pub(super) fn children_seconds() -> Option<f64> {
    parse(&std::fs::read_to_string("/proc/self/stat").ok()?)
}

/// What `measure` returns, and the seconds of processor time of the processes that it ran.
pub(super) fn timed<T>(measure: impl FnOnce() -> T) -> (T, Option<f64>) {
    let before = children_seconds();
    let result = measure();
    let seconds = before.and_then(|before| Some(children_seconds()? - before));
    (result, seconds)
}

fn parse(line: &str) -> Option<f64> {
    let fields: Vec<&str> = line.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = CHILDREN.map(|field| fields.get(field)?.parse::<f64>().ok());
    ticks.into_iter().try_fold(0.0, |sum, ticks| Some(sum + ticks? / TICKS))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_are_told_from_the_process_itself() {
        let line = "77 (deep) field) S 1 2 3 0 -1 4 5 6 7 8 1111 2222 1250 30 20 0 9 0 1";
        assert_eq!(parse(line), Some(12.8));
        assert_eq!(parse("77 (deepfield) S 1 2"), None);
        assert_eq!(parse(""), None);
    }
}
