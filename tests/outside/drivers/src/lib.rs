//! A crate whose tests use hilrig and drivers of the registry; see `tests/six.rs`.
