//! Exit of a program, and processes that it leaves behind.

use crate::support::*;

#[test]
fn who_exits_with_a_code_fails_and_its_last_words_are_shown() {
    let python = "fd = port()\nos.read(fd, 10)\nsys.exit('out of luck')\n";
    let ended = Bench::new("luck", "60s", python).run(&[]);
    assert_eq!(ended.failed(), ["program-alive"], "{}", ended.said);
    let detail = ended.check("program-alive").1;
    assert!(detail.starts_with("ended with exit code 1 at "), "{detail}");
    assert!(ended.said.contains("| out of luck"), "{}", ended.said);
    assert!(ended.log.contains("out of luck"), "{}", ended.log);
    assert!(
        ended.said.contains("repeat with: hilrig run"),
        "{}",
        ended.said
    );
    ended.assert_is_failure();
}

#[test]
fn who_exits_before_it_opens_anything_is_not_waited_for() {
    let ended = Bench::new("early", "60s", "sys.exit(3)\n").run(&[]);
    let failed = ["program-connected", "program-alive"];
    assert_eq!(ended.failed(), failed, "{}", ended.said);
    let detail = ended.check("program-alive").1;
    assert!(detail.starts_with("ended with exit code 3 at "), "{detail}");
    ended.assert_is_failure();
}

#[test]
fn who_is_killed_by_a_signal_fails_and_the_signal_is_named() {
    let python = "fd = port()\nos.read(fd, 10)\nos.kill(os.getpid(), signal.SIGSEGV)\n";
    let ended = Bench::new("segv", "60s", python).run(&[]);
    assert_eq!(ended.failed(), ["program-alive"], "{}", ended.said);
    let detail = ended.check("program-alive").1;
    assert!(detail.starts_with("ended with SIGSEGV at "), "{detail}");
    ended.assert_is_failure();
}

/// A crash in the handler of SIGTERM is an error of the program; its exit code there is not.
#[test]
fn who_crashes_when_it_is_told_to_end_fails() {
    for (name, how, fails) in [
        ("last-crash", "os.abort()", true),
        ("last-code", "os._exit(7)", false),
    ] {
        let python = format!(
            "signal.signal(signal.SIGTERM, lambda *_: {how})\nfd = port()\nwhile True:\n    \
             os.read(fd, 1)\n"
        );
        let ended = Bench::new(name, "2s", &python).run(&["--virtual"]);
        let failed = ended.failed();
        assert_eq!(failed == ["program-alive"], fails, "{}", ended.said);
        let cause = "probable cause: the program crashed while it ended, after SIGTERM: SIGABRT";
        assert_eq!(ended.said.contains(cause), fails, "{}", ended.said);
    }
}

/// A test of a device is such a program: it sends requests, compares the replies and ends.
#[test]
fn who_may_end_passes_with_code_0_and_fails_without_leave() {
    let python = "\
fd = port()
os.write(fd, b'ping\\r\\n')
heard = b''
while b'pong' not in heard:
    heard += os.read(fd, 100)
";
    let ended = Bench::new("may", "60s", python).run(&["--exec-may-end"]);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    assert_eq!(ended.code, Some(0), "{}", ended.said);

    let ended = Bench::new("may-not", "60s", python).run(&[]);
    assert_eq!(ended.failed(), ["program-alive"], "{}", ended.said);
    ended.assert_is_failure();
}

/// A child that ends on request is reported, without further effects.
#[test]
fn a_child_left_behind_is_named_and_gone() {
    let python = "\
fd = port()
os.read(fd, 10)
subprocess.Popen(['sleep', '600'])
";
    let ended = Bench::new("child", "60s", python).run(&["--exec-may-end"]);
    let (status, detail) = ended.check("no-children-left");
    assert_eq!(status, "pass", "{}", ended.said);
    assert!(detail.contains("(sleep 600)"), "{detail}");
    assert_eq!(ended.code, Some(0), "{}", ended.said);
}

#[test]
fn a_child_that_has_to_be_killed_fails_the_run() {
    let python = "\
words = \"trap '' TERM; echo ignores; sleep 600; true\"
child = subprocess.Popen(['sh', '-c', words], stdout=subprocess.PIPE)
child.stdout.readline()
fd = port()
while True:
    os.read(fd, 100)
";
    let ended = Bench::new("stubborn", "2s", python).run(&[]);
    assert_eq!(ended.failed(), ["no-children-left"], "{}", ended.said);
    let detail = ended.check("no-children-left").1;
    assert!(detail.contains("had to be killed: "), "{detail}");
    assert!(detail.contains("sleep 600"), "{detail}");
    ended.assert_is_failure();
}
