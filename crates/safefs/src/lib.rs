//! Files written relative to a directory handle, never through a link.
//!
//! Everything that hilrig writes goes through this crate. A folder of results may have been
//! prepared by another user, with links to files elsewhere, second names of them (hard links) or
//! pipes in it. Therefore:
//!
//! - A [`Dir`] is a handle. Its files are opened, renamed and removed relative to that handle, so
//!   that no parent folder can be exchanged in between.
//! - Below a [`Dir`] no link is ever followed. Each component is opened by itself with
//!   `O_NOFOLLOW`, which is what `openat2` with `RESOLVE_BENEATH | RESOLVE_NO_SYMLINKS` does, and
//!   works on every Unix.
//! - A file is new (`O_EXCL`) and takes its name by a rename or after whatever had the name was
//!   removed: the target of a link, the other names of a file and the reader of a pipe see nothing.
//! - A name that was read from a file is one component, or it is refused.
//!
//! Paths that the user gives are resolved as usual up to their last component, which is not
//! followed. The default folder `hilrig-out`, which no user types, is not followed either.

mod dir;
mod named;

#[cfg(test)]
mod tests;

pub use dir::Dir;
pub use named::{
    append, create, create_parent, open_or_create, remove_dir, remove_file, rename, write,
};
