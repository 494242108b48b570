//! Hostile and faulty clients: they are refused or limited, and the run is not affected.

use super::again;
use super::server::{Page, Server};

/// Time of the page's state after one more second of the run.
fn a_second_passes(page: &mut Page) {
    let now = page.hear("now", |_| true).expect("shown");
    let until = now["at_ns"].as_u64().expect("a time") + 1_000_000_000;
    let later = |now: &serde_json::Value| now["at_ns"].as_u64() >= Some(until);
    assert!(page.hear("now", later).is_some());
}

/// A repetition of the session gives the same bytes: no attempt changed the run.
fn nothing_got_in(server: &Server) {
    let case = server.case();
    assert!(
        !case.contains("[[mission.step]]") && !case.contains("[[fault]]"),
        "{case}"
    );
    let hash = case
        .lines()
        .find_map(|line| line.strip_prefix("trace_hash = "));
    let ran = case
        .lines()
        .find_map(|line| line.strip_prefix("duration = "));
    let span = ran.expect("has one").trim_matches('"');
    let span: hilrig::scenario::Span = span.parse().expect("a time");
    let run = again(&case, span.instant().as_nanos());
    assert_eq!(hash, Some(&*format!("{:?}", run.rig.trace_hash())));
}

#[test]
fn foreign_origins_and_hosts_are_refused() {
    let server = Server::of("empty-room", "1");
    let host = format!("Host: {}", server.host);
    assert_eq!(server.get("/").0, 200);
    for path in [
        "/",
        "/ws",
        "/case.toml",
        "/moment?at_ns=0",
        "/frames?at_ns=0",
    ] {
        let foreign = server.ask(path, &[&host, "Origin: http://evil.example"]);
        assert_eq!(foreign.0, 403, "{path}");
        assert_eq!(server.ask(path, &["Host: evil.example"]).0, 403, "{path}");
    }
    // The first of two headers may be valid, but a proxy may use the second.
    let own = format!("Origin: http://{}", server.host);
    assert_eq!(server.ask("/", &[&host, &own]).0, 200);
    for doubled in [
        &[&*host, "Host: evil.example"][..],
        &[&host, &own, "Origin: http://evil.example"],
    ] {
        assert_eq!(server.ask("/case.toml", doubled).0, 403, "{doubled:?}");
    }
    let port = server.host.rsplit_once(':').expect("a port").1;
    let rebound = format!("Host: evil.example:{port}");
    assert_eq!(server.ask("/", &[&rebound]).0, 403);
    assert_eq!(server.get("/moment?at_ns=-1").0, 400);
    assert_eq!(server.get("/../Cargo.toml").0, 404);
}

/// Another user of the machine reaches the port, but does not know the token.
#[test]
fn each_request_names_the_token() {
    let server = Server::of("empty-room", "1");
    let host = format!("Host: {}", server.host);
    let upgrade = [
        &*host,
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
    ];
    let wrong = format!("token={}", "0".repeat(32));
    for path in [
        "/",
        "/style.css",
        "/view.js",
        "/lanes.js",
        "/page.js",
        "/case.toml",
        "/moment?at_ns=0",
        "/frames?at_ns=0",
        "/ws",
        "/nowhere",
    ] {
        let joint = if path.contains('?') { '&' } else { '?' };
        for path in [path, &format!("{path}{joint}{wrong}")] {
            let (status, why) = server.ask_as_it_is(path, &upgrade);
            assert_eq!(status, 403, "{path}");
            assert!(why.contains("token"), "{path}: {why}");
        }
    }
    assert_eq!(server.get("/").0, 200);
    nothing_got_in(&server);
}

/// More connections with half a header than the server keeps: the page is still served, in place of
/// the oldest connection.
#[test]
fn half_headers_do_not_keep_the_page_away() {
    use std::io::{Read as _, Write as _};
    let server = Server::of("empty-room", "1");
    let half = (0..200).map(|_| {
        let mut socket = server.connect();
        // A connection that was closed in the meantime cannot be written to.
        let _ = socket.write_all(b"GET / HTTP/1.1\r\nX: ");
        socket
    });
    let half: Vec<_> = half.collect();
    assert_eq!(server.get("/").0, 200);
    let mut page = server.page().expect("there is room");
    a_second_passes(&mut page);
    // All of them end: the read returns a reset or nothing.
    for mut socket in half {
        let mut byte = [0; 64];
        while matches!(socket.read(&mut byte), Ok(1..)) {}
    }
    nothing_got_in(&server);
}

#[test]
fn messages_without_sense_are_refused_in_words() {
    let server = Server::of("empty-room", "1");
    let mut page = server.page().expect("there is room");
    let wrong = [
        "",
        "{",
        "null",
        r#"{"do":"fly"}"#,
        r#"{"do":"drive","axes":[300,0]}"#,
        r#"{"do":"move","index":-1,"from":[0,0],"to":[0,0]}"#,
        r#"{"do":"delete","index":99999,"at":[0,0]}"#,
        r#"{"do":"add","at":[2000000000,-5]}"#,
        r#"{"do":"end-fault","id":12345}"#,
        r#"{"do":"fault","fault":{"link":"nowhere","direction":"to-device","kind":"cut"}}"#,
        r#"{"do":"fault","fault":{"link":"base","direction":"to-device","kind":"flip","rate":7}}"#,
    ];
    for text in wrong {
        assert!(page.send(text), "{text}");
        let refused = page.hear("refused", |_| true).expect("still there");
        assert!(
            refused["why"].as_str().is_some_and(|why| !why.is_empty()),
            "{text}"
        );
    }
    a_second_passes(&mut page);
    nothing_got_in(&server);
}

#[test]
fn a_huge_message_costs_the_page_its_connection_and_nobody_else() {
    let server = Server::of("empty-room", "1");
    let mut good = server.page().expect("there is room");
    for size in [3_000, 1 << 20, 1 << 24] {
        let mut bad = server.page().expect("there is room");
        bad.send(&"x".repeat(size));
        assert!(
            bad.hear("never", |_| true).is_none(),
            "{size} bytes were taken"
        );
    }
    a_second_passes(&mut good);
    nothing_got_in(&server);
}

/// Of fifty pages, forty-nine never read a byte. The fiftieth sees the run continue, a fifty-first
/// is refused, and closed pages free their slots.
#[test]
fn fifty_pages_that_do_not_read_hold_nothing_up() {
    let flat = super::server::endless("rescue-flat", "fifty");
    let server = Server::start(&[&flat, "--speed", "30"]);
    let idle: Vec<Page> = (0..49)
        .map(|_| server.page().expect("there is room"))
        .collect();
    let mut reading = server.page().expect("the fiftieth");
    assert_eq!(server.page().err(), Some(503));
    for _ in 0..30 {
        a_second_passes(&mut reading);
    }
    drop(idle);
    // The tasks notice the closed connections when they next send.
    let free = (0..2_000).any(|_| {
        a_second_passes(&mut reading);
        server.page().is_ok()
    });
    assert!(free, "no place was given back");
    nothing_got_in(&server);
}

/// A flood of valid commands is limited, and the run still replies.
#[test]
fn a_flood_of_commands_is_bounded() {
    let server = Server::of("empty-room", "1");
    let mut page = server.page().expect("there is room");
    for _ in 0..5_000 {
        assert!(page.send(r#"{"do":"speed","x":2}"#));
    }
    let mut other = server.page().expect("there is room");
    a_second_passes(&mut other);
    nothing_got_in(&server);
}
