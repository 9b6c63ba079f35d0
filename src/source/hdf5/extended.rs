//! Floats of more than 64 bits, as sums of two doubles.

/// How the bits of such floats stand for numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Extended {
    /// Bytes of a number, of which the last may be unused.
    bytes: usize,
    is_big_endian: bool,
    /// Bits below the exponent's.
    fraction_bits: u32,
    /// Whether a bit before the fraction's is implied, as IEEE has it.
    is_one_implied: bool,
}

/// What both kinds add to their exponents, and the exponent of infinities and NaN.
const BIAS: i32 = 16383;
const NOT_FINITE: u128 = 0x7fff;

impl Extended {
    /// The kind that a datatype's message tells of (*HDF5 File Format Specification*, version 3,
    /// IV.A.2.d): the 80 bits of x87's registers, or IEEE's 128, as C's `long double` has them.
    pub(super) fn of(message: &[u8]) -> Option<Self> {
        let message: &[u8; 20] = message.get(..20)?.try_into().ok()?;
        let number = |at: usize| u16::from_le_bytes([message[at], message[at + 1]]);
        let (size, bits) = (u32::from(number(4)), number(10));
        // Sizes of exponent and mantissa with their places, and how the mantissa begins.
        let (fields, normalization) = match bits {
            80 => ([64, 15, 0, 64], 0),
            128 => ([112, 15, 0, 112], 2),
            _ => return None,
        };
        let is_float = message[0] & 0x0f == 1 && message[1] >> 4 & 3 == normalization;
        let is_big_endian = message[1] & 1 == 1;
        let is_padded = u32::from(bits) != 8 * size;
        // Neither unused bits before a number nor the order of a VAX are met with.
        let is_plain = number(6) == 0
            && number(8) == 0
            && u16::from(message[2]) + 1 == bits
            && message[12..16] == fields
            && message[16..] == BIAS.to_le_bytes()
            && message[1] & 0x40 == 0
            && u32::from(bits) <= 8 * size
            && size <= 16
            && !(is_big_endian && is_padded);
        (is_float && is_plain).then_some(Self {
            bytes: size as usize,
            is_big_endian,
            fraction_bits: u32::from(fields[3]),
            is_one_implied: normalization == 2,
        })
    }

    /// The numbers that `bytes` hold, each as a double and what is left beyond it: exact for 80 bits, to
    /// 1e-31 of the number for 128. What is not finite is NaN.
    pub(super) fn sums(self, bytes: &[u8]) -> Vec<[f64; 2]> {
        bytes.chunks_exact(self.bytes).map(|number| self.sum(number)).collect()
    }

    fn sum(self, number: &[u8]) -> [f64; 2] {
        let mut bytes = [0; 16];
        bytes[..number.len()].copy_from_slice(number);
        if self.is_big_endian {
            bytes[..number.len()].reverse();
        }
        let bits = u128::from_le_bytes(bytes);
        let exponent = bits >> self.fraction_bits & NOT_FINITE;
        if exponent == NOT_FINITE {
            return [f64::NAN, 0.0];
        }
        let is_negative = bits >> (self.fraction_bits + 15) & 1 == 1;
        let fraction = bits & ((1 << self.fraction_bits) - 1);
        let has_implied = self.is_one_implied && exponent > 0;
        let mantissa = fraction | u128::from(has_implied) << self.fraction_bits;
        let below_point = self.fraction_bits as i32 - i32::from(!self.is_one_implied);
        let power = (exponent as i32).max(1) - BIAS - below_point;
        let beyond_double = (128 - mantissa.leading_zeros()).saturating_sub(f64::MANTISSA_DIGITS);
        let first = mantissa >> beyond_double << beyond_double;
        let sign = if is_negative { -1.0 } else { 1.0 };
        // In two steps, as the power alone may be beyond a double where the number is not.
        [first, mantissa - first]
            .map(|part| sign * part as f64 * 2f64.powi(power / 2) * 2f64.powi(power - power / 2))
    }
}

#[cfg(test)]
mod tests {
    use super::Extended;

    fn x87() -> Extended {
        let message = [0x11, 0, 79, 0, 16, 0, 0, 0, 0, 0, 80, 0, 64, 15, 0, 64, 0xff, 0x3f, 0, 0];
        Extended::of(&message).unwrap()
    }

    fn ieee() -> Extended {
        let message =
            [0x11, 0x20, 127, 0, 16, 0, 0, 0, 0, 0, 128, 0, 112, 15, 0, 112, 0xff, 0x3f, 0, 0];
        Extended::of(&message).unwrap()
    }

    fn sum(kind: Extended, bits: u128) -> [f64; 2] {
        kind.sums(&bits.to_le_bytes())[0]
    }

    #[test]
    fn numbers_by_hand() {
        // Whatever stands in the six bytes that are not used.
        let unused = 0xabcd << 80;
        for (bits, expected) in [
            (0x3fff_8000_0000_0000_0000, [1.0, 0.0]),
            (0xc000_c000_0000_0000_0000, [-3.0, 0.0]),
            (0x3ffe_8000_0000_0000_0001, [0.5, 2f64.powi(-64)]),
            (0xbffe_ffff_ffff_ffff_ffff, [-1.0 + 2f64.powi(-53), -2047.0 * 2f64.powi(-64)]),
            (0x3c01_8000_0000_0000_0000, [2f64.powi(-1022), 0.0]),
            (0x43fe_8000_0000_0000_0000, [2f64.powi(1023), 0.0]),
            (0, [0.0, 0.0]),
            (1, [0.0, 0.0]),
        ] {
            assert_eq!(sum(x87(), bits | unused), expected, "{bits:x}");
        }
        let exponent = |exponent: u128| exponent << 112;
        for (bits, expected) in [
            (exponent(0x3fff), [1.0, 0.0]),
            (exponent(0xc000) | 1 << 111, [-3.0, 0.0]),
            (exponent(0x3ffe) | 1, [0.5, 2f64.powi(-113)]),
            (exponent(0x3c01), [2f64.powi(-1022), 0.0]),
            (1, [0.0, 0.0]),
        ] {
            assert_eq!(sum(ieee(), bits), expected, "{bits:x}");
            let big_endian = Extended { is_big_endian: true, ..ieee() };
            assert_eq!(big_endian.sums(&bits.to_be_bytes()), [expected]);
        }
        assert!(sum(x87(), 0x7fff_8000_0000_0000_0000)[0].is_nan());
        assert!(!sum(ieee(), exponent(0x7ffe))[0].is_finite());
    }

    #[test]
    fn other_layouts_are_none_of_these() {
        let message = [0x11, 0, 79, 0, 16, 0, 0, 0, 0, 0, 80, 0, 64, 15, 0, 64, 0xff, 0x3f, 0, 0];
        for place in [0, 1, 2, 4, 5, 6, 8, 10, 12, 13, 14, 15, 16, 18] {
            let mut other = message;
            other[place] ^= 0x21;
            assert_eq!(Extended::of(&other), None, "{place}");
        }
        assert_eq!(Extended::of(&message[..19]), None);
        assert_eq!(Extended::of(&[]), None);
    }
}
