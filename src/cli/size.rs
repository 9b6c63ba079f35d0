//! Sizes as users write them.

/// Parses `256MiB`, `1GiB`, `500MB`, `4096`: bytes.
///
/// # Errors
/// What is not such a size, in words for clap.
pub(super) fn parse(text: &str) -> Result<u64, String> {
    let body = text.trim();
    let split = body.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(body.len());
    let (number, unit) = body.split_at(split);
    let number: f64 =
        number.parse().map_err(|_| format!("`{text}` is no size: write one as 256MiB or 1GiB"))?;
    let factor: u64 = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1,
        "kb" => 1_000,
        "mb" => 1_000_000,
        "gb" => 1_000_000_000,
        "tb" => 1_000_000_000_000,
        "k" | "kib" => 1 << 10,
        "m" | "mib" => 1 << 20,
        "g" | "gib" => 1 << 30,
        "t" | "tib" => 1 << 40,
        other => return Err(format!("`{other}` is no unit of size: use KiB, MiB, GiB, MB or GB")),
    };
    let bytes = number * factor as f64;
    if bytes > (1u64 << 60) as f64 {
        return Err(format!("`{text}` is more than any machine has"));
    }
    Ok(bytes as u64)
}

/// `bytes` for a reader.
pub(super) fn show(bytes: u64) -> String {
    let units = ["B", "KiB", "MiB", "GiB", "TiB"];
    let mut value = bytes as f64;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < units.len() {
        value /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{bytes} B") } else { format!("{value:.1} {}", units[unit]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_written() {
        assert_eq!(parse("256MiB"), Ok(256 << 20));
        assert_eq!(parse("1.5 GiB"), Ok(3 << 29));
        assert_eq!(parse("500MB"), Ok(500_000_000));
        assert_eq!(parse("4096"), Ok(4096));
        for wrong in ["", "MiB", "1 fathom", "-1MiB", "1e3", "1.2.3GiB", "99999999999999999999TiB"]
        {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
        assert_eq!(show(1536), "1.5 KiB");
    }
}
