//! The secret in the page's address: a browser with the token may see and control the run.
//!
//! Other users of the machine can reach its loopback address too, and a browser sends cookies to
//! every port of a host. Therefore each request contains the token in its query.

use core::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read as _};
use std::sync::Arc;

/// Number of random bytes in a token.
const LEN: usize = 16;
/// Source of random bytes.
const SOURCE: &str = "/dev/urandom";
const KEY: &str = "token";
/// Environment variable with a user-defined token, which stays the same after a restart of the
/// server.
const VARIABLE: &str = "HILRIG_TOKEN";
/// Minimum length of a user-defined token.
const LEN_MIN: usize = 16;

/// A token: user-defined, or new for each server.
#[derive(Clone, Debug)]
pub(super) struct Token(Arc<str>);

impl Token {
    /// The token in `HILRIG_TOKEN`; otherwise a random one.
    pub(super) fn new() -> io::Result<Self> {
        if let Some(own) = std::env::var_os(VARIABLE) {
            let own = own.to_str().filter(|own| is_usable(own));
            return own.map(|own| Self(own.into())).ok_or_else(|| {
                let kind = io::ErrorKind::InvalidInput;
                let message = format!(
                    "{VARIABLE}: expected at least {LEN_MIN} letters, digits, \"-\" and \"_\""
                );
                io::Error::new(kind, message)
            });
        }
        let mut bytes = [0; LEN];
        File::open(SOURCE)?.read_exact(&mut bytes)?;
        let mut text = String::new();
        for byte in bytes {
            write!(text, "{byte:02x}").expect("a string takes everything");
        }
        Ok(Self(text.into()))
    }

    /// The token as the query of an address.
    pub(super) fn query(&self) -> String {
        format!("{KEY}={}", self.0)
    }

    /// Whether `query` contains the token.
    pub(super) fn is_in(&self, query: Option<&str>) -> bool {
        let pairs = query.unwrap_or_default().split('&');
        let mut named = pairs
            .filter_map(|pair| pair.split_once('='))
            .filter(|(key, _)| *key == KEY);
        // A proxy could check the second token.
        matches!((named.next(), named.next()), (Some((_, token)), None) if self.is(token))
    }

    /// Compares in constant time.
    fn is(&self, token: &str) -> bool {
        let pairs = self.0.bytes().zip(token.bytes());
        let differences = pairs.fold(0, |all, (a, b)| all | (a ^ b));
        self.0.len() == token.len() && differences == 0
    }
}

/// Whether a token is long enough, and needs no escapes in an address.
fn is_usable(token: &str) -> bool {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_".contains(&byte);
    token.len() >= LEN_MIN && token.bytes().all(is_plain)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_of_the_users_own_is_long_and_plain() {
        assert!(is_usable("0123456789abcdef") && is_usable("a-long_enough-token"));
        for wrong in ["", "short", "0123456789abcde ", "0123456789abcdef&x=1"] {
            assert!(!is_usable(wrong), "{wrong}");
        }
    }

    #[test]
    fn only_the_whole_token_named_once_counts() {
        let token = Token::new().expect("there are random numbers");
        let query = token.query();
        assert_eq!(query.len(), "token=".len() + 2 * LEN);
        for right in [
            query.clone(),
            format!("at_ns=5&{query}"),
            format!("{query}&a"),
        ] {
            assert!(token.is_in(Some(&right)), "{right}");
        }
        let short = &query[..query.len() - 1];
        for wrong in [
            short,
            &format!("{query}0"),
            &format!("{query}&{query}"),
            &format!("x{query}"),
            "token=",
            "token",
            "",
        ] {
            assert!(!token.is_in(Some(wrong)), "{wrong}");
        }
        assert!(!token.is_in(None));
        let other = Token::new().expect("there are random numbers");
        assert!(!other.is_in(Some(&query)));
    }
}
