//! A size limit for unpacked archives.

use std::io::Read;

/// Maximum number of unpacked bytes: more than an hour of four full lines; no archive can fill the
/// memory.
const UNPACKED_MAX: u64 = 256 << 20;

/// Reads all of `from`, up to the limit.
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
