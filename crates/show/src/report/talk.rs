//! Requests and replies of a run without a robot.

use core::time::Duration;

use engine::run::Outcome;
use engine::run::wire_log::{self, Dialogue, Exchange, Frame, ReplyTimes};
use protocols::Instant;

use super::{row, section};
use crate::html::escape;

/// Maximum number of listed exchanges, the last ones.
const ROWS_MAX: usize = 200;
/// Number of exchanges in the picture of a failure.
const MOMENT_MAX: usize = 6;
/// Columns of the exchanges.
const HEAD: &str = "<tr><th>time, s</th><th>link</th><th>request (to-device)</th>\
                    <th>reply (to-master)</th><th>reply time</th></tr>";
/// Maximum number of listed bytes of a frame.
const BYTES_MAX: usize = 64;
/// Maximum number of characters of a frame's words.
const WORDS_MAX: usize = 300;

/// The last requests and replies of a run, and figures of each link.
pub(super) struct Talk(Dialogue);

impl Talk {
    /// The requests and replies of `outcome`; `None` with a robot.
    pub(super) fn of(outcome: &Outcome) -> Option<Self> {
        Self::until(outcome, Instant::ZERO + outcome.ran, ROWS_MAX)
    }

    fn until(outcome: &Outcome, until: Instant, rows: usize) -> Option<Self> {
        let log = outcome.wire_log.as_ref()?;
        Some(Self(log.heard(until).dialogue(rows)))
    }

    /// Times of the replies, as plots of the time line.
    pub(super) fn reply_times(&self) -> &[ReplyTimes] {
        &self.0.plots
    }

    /// Figures of all links together.
    pub(super) fn tiles(&self) -> Vec<(&'static str, Option<String>)> {
        let sum = |of: fn(&wire_log::Talk) -> u64| self.0.talks.iter().map(of).sum::<u64>();
        let longest = self.0.talks.iter().filter_map(|link| link.reply_ms_max);
        let longest = longest.reduce(f64::max).map(|ms| format!("{ms} ms"));
        let (asked, open) = (sum(|link| link.requests), sum(|link| link.unanswered));
        vec![
            ("requests", Some(asked.to_string())),
            ("requests without a reply", Some(open.to_string())),
            ("longest reply time", longest),
        ]
    }

    /// A row for each link, and the last exchanges with words and bytes.
    pub(super) fn section(&self) -> String {
        let head = "<thead><tr><th>link</th><th>bytes to-device</th><th>bytes to-master</th>\
                    <th>requests</th><th>without a reply</th><th>unrequested frames</th>\
                    <th>invalid</th><th>reply time, median</th><th>longest</th></tr></thead>";
        let Dialogue {
            talks, exchanges, ..
        } = &self.0;
        let links: String = talks.iter().map(link).collect();
        let rows: String = exchanges.iter().map(|one| exchange(one, true)).collect();
        let more = match self.0.listed_from_s {
            0.0 => String::new(),
            from => format!(
                "<p>The figures count the whole run. Listed are requests and replies from {from:.3} \
                 s on; earlier ones are in the capture.</p>\n"
            ),
        };
        let none = match talks
            .iter()
            .all(|talk| talk.bytes_to_master + talk.bytes_to_device == 0)
        {
            true => "<p>No byte was on a link.</p>\n",
            false => "",
        };
        let content = format!(
            "<div class=\"across\" tabindex=\"0\" role=\"region\" aria-label=\"Figures of the \
             links\"><table id=\"links\">{head}<tbody>\n{links}</tbody></table></div>\n{none}{more}\
             <div class=\"across\" tabindex=\"0\" role=\"region\" aria-label=\"All requests \
             and replies\"><table id=\"exchanges\"><thead>{HEAD}</thead>\
             <tbody>\n{rows}</tbody></table></div>\n"
        );
        section("talk", "Requests and replies", &content)
    }
}

/// The last exchanges until `at`, seconds, for a page without a script; nothing with a robot.
pub(super) fn moment(outcome: &Outcome, at: f64) -> String {
    let until = Instant::ZERO + Duration::from_secs_f64(at.max(0.0));
    let Some(Talk(told)) = Talk::until(outcome, until, MOMENT_MAX) else {
        return String::new();
    };
    let rows: String = told
        .exchanges
        .iter()
        .map(|one| exchange(one, false))
        .collect();
    let (table, words) = match (told.late_s, rows.is_empty()) {
        (Some(_), _) => (
            String::new(),
            "requests and replies of this time are no longer kept; see the capture:",
        ),
        (None, true) => (String::new(), "no requests or replies"),
        (None, false) => (
            format!("<table><thead>{HEAD}</thead><tbody>\n{rows}</tbody></table>"),
            "the last requests and replies",
        ),
    };
    format!(
        "<figure class=\"moment\">{table}<figcaption>{words} until {at:.1} s after the start\
         </figcaption></figure>"
    )
}

/// Time of the first frame of an exchange, seconds.
fn begin(one: &Exchange) -> f64 {
    one.begin_ns() as f64 / 1e9
}

fn link(talk: &wire_log::Talk) -> String {
    let ms = |value: Option<f64>| value.map_or("none".to_owned(), |ms| format!("{ms} ms"));
    let cells = [
        escape(&talk.link),
        talk.bytes_to_device.to_string(),
        talk.bytes_to_master.to_string(),
        talk.requests.to_string(),
        talk.unanswered.to_string(),
        talk.unasked.to_string(),
        talk.bad.to_string(),
        ms(talk.reply_ms),
        ms(talk.reply_ms_max),
    ];
    row("", &cells.each_ref().map(String::as_str))
}

/// The row of an exchange; its time is a button in a report with a script.
fn exchange(one: &Exchange, has_script: bool) -> String {
    let at = format!("{:.6}", begin(one));
    let at = if has_script {
        super::with_jumps(&at)
    } else {
        at
    };
    let time = match one.is_unanswered() {
        true => "no reply".to_owned(),
        false => one
            .reply_ms
            .map_or_else(String::new, |ms| format!("{ms} ms")),
    };
    let class = if time == "no reply" { "open" } else { "" };
    let (request, reply) = (words(one.request.as_ref()), words(one.reply.as_ref()));
    row(class, &[&at, &escape(&one.link), &request, &reply, &time])
}

/// Words and bytes of a frame.
fn words(frame: Option<&Frame>) -> String {
    let Some(frame) = frame else {
        return String::new();
    };
    let mut pairs: Vec<&str> = Vec::new();
    let mut rest = &*frame.bytes;
    while let Some((pair, after)) = rest.split_at_checked(2)
        && pairs.len() < BYTES_MAX
    {
        pairs.push(pair);
        rest = after;
    }
    let more = if rest.is_empty() { "" } else { " .." };
    let marks = match (frame.is_bad, frame.is_hit) {
        (false, false) => "",
        (true, false) => "<b class=\"fail\">invalid</b> ",
        (false, true) => "<b class=\"faults\">hit by a fault</b> ",
        (true, true) => "<b class=\"fail\">invalid</b> <b class=\"faults\">hit by a fault</b> ",
    };
    let words: String = frame.words.chars().take(WORDS_MAX).collect();
    let dots = if words.len() < frame.words.len() {
        " .."
    } else {
        ""
    };
    let (words, bytes) = (escape(&words), pairs.join(" "));
    format!("{marks}{words}{dots}<br><code>{bytes}{more}</code>")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(way: &'static str, at_ns: u64, words: &str) -> Frame {
        Frame {
            at_ns,
            link: "scale".to_owned(),
            way,
            words: words.to_owned(),
            bytes: "53490D0A".to_owned(),
            is_bad: false,
            is_hit: way == "to-master",
        }
    }

    /// A reply after 30 ms, hit by a fault, and a request without a reply. Markup of a device is
    /// text; long words are cut. Invalid bytes are no request without a reply.
    #[test]
    fn requests_and_replies_have_words_bytes_and_times() {
        let exchange = |request, reply| Exchange {
            link: "scale".to_owned(),
            request,
            reply,
            reply_ms: None,
        };
        let reply = frame("to-master", 1_030_000_000, "<b>");
        let noise = Frame {
            is_bad: true,
            ..frame("to-device", 3_000_000_000, &"x".repeat(1_000))
        };
        let first = Exchange {
            reply_ms: Some(30.0),
            ..exchange(
                Some(frame("to-device", 1_000_000_000, "text \"SI\"")),
                Some(reply),
            )
        };
        let html = Talk(Dialogue {
            talks: vec![wire_log::Talk {
                link: "scale".to_owned(),
                since_s: None,
                bytes_to_master: 4,
                bytes_to_device: 12,
                requests: 2,
                unanswered: 1,
                unasked: 0,
                bad: 1,
                reply_ms: Some(30.0),
                reply_ms_max: Some(30.0),
            }],
            plots: Vec::new(),
            exchanges: vec![
                first,
                exchange(Some(frame("to-device", 2_000_000_000, "text \"SI\"")), None),
                exchange(Some(noise), None),
            ],
            listed_from_s: 1.0,
            late_s: None,
        })
        .section();
        for part in [
            "text &quot;SI&quot;<br><code>53 49 0D 0A</code>",
            "<b class=\"faults\">hit by a fault</b> &lt;b&gt;<br>",
            "<td>30 ms</td></tr>",
            "<td>no reply</td></tr>",
            "data-at=\"1.000000\"",
            "<td>12</td><td>4</td><td>2</td><td>1</td><td>0</td><td>1</td><td>30 ms</td>",
            "from 1.000 s on",
            "xxx ..<br>",
        ] {
            assert!(html.contains(part), "{part}: {html}");
        }
        assert_eq!(html.matches("no reply").count(), 1);
        assert!(!html.contains(&"x".repeat(WORDS_MAX + 1)));
    }
}
