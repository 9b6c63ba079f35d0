//! The process' own memory, as the system counts it.

/// The largest resident set that the process has had so far (VmHWM), bytes; none where the
/// system does not say.
pub(crate) fn peak_rss_bytes() -> Option<u64> {
    parse_peak(&std::fs::read_to_string("/proc/self/status").ok()?)
}

/// The line `VmHWM:   1234 kB` of a status file.
fn parse_peak(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim_end().parse().ok()?;
    kibibytes.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_status_line_is_read_in_kibibytes() {
        let status = "Name:\tdeepfield\nVmPeak:\t 999 kB\nVmHWM:\t   5320 kB\nVmRSS:\t 1 kB\n";
        assert_eq!(parse_peak(status), Some(5320 * 1024));
        assert_eq!(parse_peak("Name:\tdeepfield\n"), None);
        assert_eq!(parse_peak("VmHWM:\t99999999999999999999 kB\n"), None);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn touched_memory_shows() {
        let bytes = 64 << 20;
        let touched = std::hint::black_box(vec![1u8; bytes]);
        assert!(peak_rss_bytes().unwrap() > bytes as u64);
        drop(touched);
    }
}
