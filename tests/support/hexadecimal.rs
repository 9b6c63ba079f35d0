//! C99 hexadecimal floats, as the facts beside real data give positions.

/// The double that a C99 hexadecimal literal is: `[-]0xH.HHHp±D`.
pub(crate) fn parse(text: &str) -> Option<f64> {
    let (sign, body) = text.strip_prefix('-').map_or((1.0, text), |body| (-1.0, body));
    let (mantissa, exponent) = body.strip_prefix("0x")?.split_once('p')?;
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = u64::from_str_radix(&format!("{whole}{fraction}"), 16).ok()?;
    let power = exponent.parse::<i32>().ok()? - 4 * i32::try_from(fraction.len()).ok()?;
    Some(sign * digits as f64 * f64::from(power).exp2())
}
