//! Arduino's text format of a floating-point number.

use core::fmt;

/// Limit of the Arduino's output, because the whole part must fit 32 bits.
const WHOLE_MAX: f32 = 4_294_967_040.0;

/// Prints `number` like the Arduino core's `Print::print(double, digits)` with a double of 32 bits.
/// Half a unit of the last decimal is added, then decimals are cut off one by one, each step
/// rounded to 32 bits. The result is not always the nearest decimal, and -0.001 prints as `-0.00`.
///
/// # Errors
/// Those of `out`.
pub fn print_float(out: &mut impl fmt::Write, number: f32, digits: u8) -> fmt::Result {
    if number.is_nan() {
        return out.write_str("nan");
    }
    if number.is_infinite() {
        return out.write_str("inf");
    }
    if number.abs() > WHOLE_MAX {
        return out.write_str("ovf");
    }
    if number < 0.0 {
        out.write_char('-')?;
    }
    let half = (0..digits).fold(0.5_f32, |half, _| half / 10.0);
    let rounded = number.abs() + half;
    let whole = whole(rounded);
    write!(out, "{whole}")?;
    if digits == 0 {
        return Ok(());
    }
    out.write_char('.')?;
    #[expect(clippy::cast_precision_loss, reason = "as the microcontroller does it")]
    let mut rest = rounded - whole as f32;
    for _ in 0..digits {
        rest *= 10.0;
        let digit = self::whole(rest);
        write!(out, "{digit}")?;
        #[expect(clippy::cast_precision_loss, reason = "a digit")]
        let digit = digit as f32;
        rest -= digit;
    }
    Ok(())
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "cuts the decimals off a number that is not negative, which is meant"
)]
const fn whole(number: f32) -> u32 {
    number as u32
}
