//! A limit for what archives may unpack to.

use std::io::Read;

/// Maximum number of bytes that are unpacked: more than an hour of four full lines, and no archive
/// can fill the memory.
const UNPACKED_MAX: u64 = 256 << 20;

/// All that `from` holds, if that is not too much.
pub(super) fn limited(from: impl Read) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    from.take(UNPACKED_MAX + 1)
        .read_to_end(&mut out)
        .map_err(|error| format!("is damaged: {error}; make it again"))?;
    if out.len() as u64 > UNPACKED_MAX {
        let mib = UNPACKED_MAX >> 20;
        return Err(format!(
            "unpacks to more than {mib} MiB: cut the recording into parts"
        ));
    }
    Ok(out)
}
