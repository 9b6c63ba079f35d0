//! The numbers that the pure-Rust reader reads, one type each.

use hdf5_reader::error::{ByteOrder, Error};
use hdf5_reader::{Datatype, H5Type};

use super::Element;

/// A number that a file may hold.
pub(super) trait Number: H5Type {
    /// What kind of element it is.
    const ELEMENT: Element;
    /// The number as f64, rounded where it has more than 53 bits.
    fn to_f64(self) -> f64;
    /// The number as i64; beyond its limits the nearer of them.
    fn to_i64(self) -> i64;
}

macro_rules! number {
    ($($type:ident $element:ident $to_f64:expr, $to_i64:expr;)*) => {$(
        impl Number for $type {
            const ELEMENT: Element = Element::$element;
            fn to_f64(self) -> f64 {
                $to_f64(self)
            }
            fn to_i64(self) -> i64 {
                $to_i64(self)
            }
        }
    )*};
}

number! {
    Half Float |v: Half| f64::from(v.0), |v: Half| v.0 as i64;
    f32 Float f64::from, |v| v as i64;
    f64 Float f64::from, |v| v as i64;
    i8 Integer f64::from, i64::from;
    u8 Integer f64::from, i64::from;
    i16 Integer f64::from, i64::from;
    u16 Integer f64::from, i64::from;
    i32 Integer f64::from, i64::from;
    u32 Integer f64::from, i64::from;
    i64 Integer |v| v as f64, i64::from;
    u64 Integer |v| v as f64, |v| i64::try_from(v).unwrap_or(i64::MAX);
}

/// Evaluates the first expression with `$type` standing for the [`Number`] that the datatype is,
/// or the second if it is none.
macro_rules! with_number {
    ($datatype:expr, $type:ident => $some:expr, else $none:expr) => {
        with_number!(@match $datatype, $type, $some, $none,
            FloatingPoint { size: 2 } Half, FloatingPoint { size: 4 } f32,
            FloatingPoint { size: 8 } f64,
            FixedPoint { size: 1, signed: true } i8, FixedPoint { size: 1, signed: false } u8,
            FixedPoint { size: 2, signed: true } i16, FixedPoint { size: 2, signed: false } u16,
            FixedPoint { size: 4, signed: true } i32, FixedPoint { size: 4, signed: false } u32,
            FixedPoint { size: 8, signed: true } i64, FixedPoint { size: 8, signed: false } u64)
    };
    (@match $datatype:expr, $type:ident, $some:expr, $none:expr,
     $($class:ident { $($key:ident : $value:literal),* } $number:ident),*) => {
        match $datatype {
            $(Datatype::$class { $($key: $value,)* .. } => {
                type $type = $number;
                $some
            })*
            _ => $none,
        }
    };
}

pub(super) use with_number;

/// What elements of `datatype` are.
pub(super) fn element(datatype: &Datatype) -> Element {
    with_number!(datatype, T => T::ELEMENT, else match datatype {
        Datatype::String { .. } => Element::Text,
        _ => Element::Other,
    })
}

/// Whether a datatype's message tells of IEEE floats, or of integers that fill their bytes (*HDF5 File
/// Format Specification*, version 3, IV.A.2.d).
pub(super) fn has_plain_bits(message: &[u8]) -> bool {
    let number = |at: usize, bytes: usize| message.get(at..at + bytes).map(little_endian);
    let Some(bits) = number(4, 4).map(|size| size.saturating_mul(8)) else { return false };
    // Class in the lower half of the first byte; then flags, size, offset and precision of the bits.
    if number(8, 2) != Some(0) || number(10, 2) != Some(bits) {
        return false;
    }
    if message[0] & 0x0f == 0 {
        return true;
    }
    // Place and size of the exponent, place and size of the mantissa, bias.
    let (exponent, bias) = match bits {
        16 => ([10, 5, 0, 10], 15),
        32 => ([23, 8, 0, 23], 127),
        64 => ([52, 11, 0, 52], 1023),
        _ => return false,
    };
    // The mantissa's first bit is implied.
    let is_normal = message[1] >> 4 & 3 == 2 && u32::from(message[2]) + 1 == bits;
    is_normal && message.get(12..16) == Some(&exponent) && number(16, 4) == Some(bias)
}

fn little_endian(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte))
}

/// An IEEE number of 16 bits, widened.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Half(f32);

impl Half {
    fn from_bits(bits: u16) -> Self {
        let sign = u32::from(bits >> 15) << 31;
        let (exponent, mantissa) = (u32::from(bits >> 10 & 0x1f), u32::from(bits & 0x3ff));
        let magnitude = match exponent {
            // Below the smallest normal number the mantissa counts in units of 2^-24.
            0 => (mantissa as f32 * 2f32.powi(-24)).to_bits(),
            0x1f => 0x7f80_0000 | mantissa << 13,
            _ => (exponent + 127 - 15) << 23 | mantissa << 13,
        };
        Self(f32::from_bits(sign | magnitude))
    }
}

impl H5Type for Half {
    fn hdf5_type() -> Datatype {
        Datatype::FloatingPoint { size: 2, byte_order: ByteOrder::LittleEndian }
    }

    fn from_bytes(bytes: &[u8], datatype: &Datatype) -> Result<Self, Error> {
        match (datatype, bytes) {
            (Datatype::FloatingPoint { size: 2, byte_order }, &[a, b]) => {
                Ok(Self::from_bits(match byte_order {
                    ByteOrder::LittleEndian => u16::from_le_bytes([a, b]),
                    ByteOrder::BigEndian => u16::from_be_bytes([a, b]),
                }))
            }
            _ => Err(Error::InvalidData("expected a 16-bit float".to_owned())),
        }
    }

    fn element_size(_datatype: &Datatype) -> usize {
        2
    }
}

#[cfg(test)]
mod tests {
    use super::Half;

    #[test]
    fn halves_by_hand() {
        for (bits, value) in [
            (0x0000, 0.0),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x3555, 0.333_251_95),
            (0x7bff, 65504.0),
            (0x0400, 2f32.powi(-14)),
            (0x0001, 2f32.powi(-24)),
            (0x83ff, -1023.0 * 2f32.powi(-24)),
            (0x7c00, f32::INFINITY),
        ] {
            assert_eq!(Half::from_bits(bits), Half(value), "{bits:x}");
        }
        assert!(Half::from_bits(0x7e00).0.is_nan());
        assert!(Half::from_bits(0x8000).0.is_sign_negative());
    }
}
