//! Access control of the server. A foreign page in the same browser must not reach it: neither with
//! its own request (checked by the origin), nor with a host name that resolves to this machine
//! (checked by the host).

use core::net::{IpAddr, SocketAddr};

/// Whether a request with this `host` and `origin` is for the server at `listen`, and comes from
/// its own page or from a program without an origin.
pub(super) fn admits(listen: SocketAddr, host: Option<&str>, origin: Option<&str>) -> bool {
    let Some(host) = host.filter(|host| is_ours(listen, host)) else {
        return false;
    };
    origin.is_none_or(|origin| origin.strip_prefix("http://") == Some(host))
}

/// Whether `host` is an address of this server. Names are rejected, except `localhost`.
fn is_ours(listen: SocketAddr, host: &str) -> bool {
    let (name, port) = match host.rsplit_once(':') {
        Some((name, port)) if !port.ends_with(']') => (name, port.parse::<u16>().ok()),
        _ => (host, Some(80)),
    };
    if port != Some(listen.port()) {
        return false;
    }
    let address = name.trim_start_matches('[').trim_end_matches(']');
    let is_local = |ip: IpAddr| ip.is_loopback();
    match address.parse::<IpAddr>() {
        // A server on all addresses accepts any numeric address: an attack needs a host name.
        Ok(ip) => ip == listen.ip() || is_local(ip) || listen.ip().is_unspecified(),
        Err(_) => address == "localhost",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(listen: &str, host: &str, origin: Option<&str>) -> bool {
        admits(listen.parse().expect("an address"), Some(host), origin)
    }

    #[test]
    fn the_own_page_and_programs_are_admitted() {
        let here = "127.0.0.1:8080";
        assert!(at(here, "127.0.0.1:8080", None));
        assert!(at(here, "localhost:8080", Some("http://localhost:8080")));
        assert!(at(here, "[::1]:8080", Some("http://[::1]:8080")));
        assert!(at("0.0.0.0:80", "192.168.1.7", Some("http://192.168.1.7")));
        assert!(at("192.168.1.7:99", "192.168.1.7:99", None));
    }

    #[test]
    fn foreign_origins_and_names_are_refused() {
        let here = "127.0.0.1:8080";
        assert!(!at(here, "127.0.0.1:8080", Some("http://evil.example")));
        assert!(!at(here, "127.0.0.1:8080", Some("http://localhost:8080")));
        assert!(!at(here, "127.0.0.1:8080", Some("https://127.0.0.1:8080")));
        assert!(!at(here, "127.0.0.1:8080", Some("null")));
        assert!(!at(here, "evil.example:8080", None));
        assert!(!at(here, "127.0.0.1.evil.example:8080", None));
        assert!(!at(here, "127.0.0.1:8081", None));
        assert!(!at(here, "127.0.0.1", None));
        assert!(!at(here, "10.0.0.1:8080", None));
        assert!(!at("0.0.0.0:80", "evil.example", None));
        assert!(!admits(here.parse().expect("ok"), None, None));
    }
}
