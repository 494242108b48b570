//! Verification of a line by the fielded host.

/// Whether the car's own program accepts a line: five figures, and the sum of the first four, added
/// up from the left in 32 bits, exactly equal to the fifth. With fewer figures that program reads
/// beyond its list; here such a line is refused.
pub fn passes_exact_sum(content: &[u8]) -> bool {
    let mut fields = content.split(|byte| *byte == b'*');
    let mut figures = [0.0_f32; 5];
    for figure in &mut figures {
        let text = fields.next().and_then(|field| str::from_utf8(field).ok());
        let Some(Ok(value)) = text.map(str::parse) else {
            return false;
        };
        *figure = value;
    }
    let [distance, rate, yaw, time, sum] = figures;
    #[expect(clippy::float_cmp, reason = "the defect that this is about")]
    let equal = ((distance + rate) + yaw) + time == sum;
    equal
}
