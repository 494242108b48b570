//! Files written relative to a directory handle, never through a link.
//!
//! Everything that hilrig writes goes through this crate. Another user may have prepared a result
//! folder with links to files elsewhere, second names of files (hard links), or pipes. Therefore:
//!
//! - A [`Dir`] is a handle. Its files are opened, renamed and removed relative to that handle, so
//!   that another process cannot exchange a parent folder in between.
//! - Below a [`Dir`], no link is ever followed. Each component is opened separately with
//!   `O_NOFOLLOW`. This equals `openat2` with `RESOLVE_BENEATH | RESOLVE_NO_SYMLINKS` and works on
//!   every Unix.
//! - A file is new (`O_EXCL`). It gets its name by a rename, or after an existing entry of that
//!   name was removed. The target of a link, the other names of a file and the reader of a pipe are
//!   not affected.
//! - A name that was read from a file must be a single component; otherwise it is refused.
//! - A file of a folder is read with [`open`], [`read`] or [`read_text`]: a pipe in its place,
//!   whose writer may never come, is an error.
//!
//! Paths from the user are resolved as usual up to the last component, which is not followed if it
//! is a link. The default folder `hilrig-out`, which the user never types, is not followed either.

mod dir;
mod named;

#[cfg(test)]
mod tests;

pub use dir::Dir;
pub use named::{
    append, create, create_parent, open, open_or_create, read, read_text, remove_dir, remove_file,
    rename, write,
};
