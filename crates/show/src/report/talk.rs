//! Requests and replies of a run without a robot.

use engine::run::Outcome;
use engine::run::wire_log::{self, Exchange, Frame, ReplyTimes};
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

/// The last requests and replies of a run, and figures of each link.
pub(super) struct Talk {
    exchanges: Vec<Exchange>,
    links: Vec<wire_log::Talk>,
}

impl Talk {
    /// The requests and replies of `outcome`; `None` with a robot.
    pub(super) fn of(outcome: &Outcome) -> Option<Self> {
        let (log, end) = (outcome.wire_log.as_ref()?, Instant::ZERO + outcome.ran);
        let frames = wire_log::all_frames(&log.last_tails(end, usize::MAX));
        let exchanges = wire_log::exchanges(frames);
        let links = wire_log::talks(&log.totals(end), &exchanges);
        Some(Self { exchanges, links })
    }

    /// Times of the replies, as plots of the time line.
    pub(super) fn reply_times(&self) -> Vec<ReplyTimes> {
        wire_log::reply_times(&self.exchanges)
    }

    /// Figures of all links together.
    pub(super) fn tiles(&self) -> Vec<(&'static str, Option<String>)> {
        let sum = |of: fn(&wire_log::Talk) -> usize| self.links.iter().map(of).sum::<usize>();
        let longest = self.links.iter().filter_map(|link| link.reply_ms_max);
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
        let links: String = self.links.iter().map(link).collect();
        let skipped = self.exchanges.len().saturating_sub(ROWS_MAX);
        let rows = self.exchanges[skipped..].iter();
        let rows: String = rows.map(|one| exchange(one, true)).collect();
        let more = match skipped {
            0 => String::new(),
            skipped => format!("<p>{skipped} earlier ones are in the capture.</p>\n"),
        };
        let none = match self.exchanges.is_empty() {
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

impl Talk {
    /// The last exchanges until `at`, seconds, for a page without a script.
    pub(super) fn moment(&self, at: f64) -> String {
        let until = self.exchanges.partition_point(|one| begin(one) <= at);
        let shown = &self.exchanges[until.saturating_sub(MOMENT_MAX)..until];
        let rows: String = shown.iter().map(|one| exchange(one, false)).collect();
        format!(
            "<figure class=\"moment\"><table><thead>{HEAD}</thead><tbody>\n{rows}</tbody></table>\
             <figcaption>the last requests and replies until {at:.1} s after the start\
             </figcaption></figure>"
        )
    }
}

/// Time of the first frame of an exchange, seconds.
fn begin(one: &Exchange) -> f64 {
    let first = one.request.as_ref().or(one.reply.as_ref());
    first.map_or(0.0, |frame| frame.at_ns as f64 / 1e9)
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
    let time = match (&one.request, one.reply_ms) {
        (Some(_), None) => "no reply".to_owned(),
        (_, ms) => ms.map_or_else(String::new, |ms| format!("{ms} ms")),
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
    let (words, bytes) = (escape(&frame.words), pairs.join(" "));
    format!("{marks}{words}<br><code>{bytes}{more}</code>")
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
    /// text.
    #[test]
    fn requests_and_replies_have_words_bytes_and_times() {
        let frames = vec![
            frame("to-device", 1_000_000_000, "text \"SI\""),
            frame("to-master", 1_030_000_000, "<b>"),
            frame("to-device", 2_000_000_000, "text \"SI\""),
        ];
        let exchanges = wire_log::exchanges(frames);
        let links = wire_log::talks(&[("scale".to_owned(), [4, 8])], &exchanges);
        let talk = Talk { exchanges, links };
        let html = talk.section();
        for part in [
            "text &quot;SI&quot;<br><code>53 49 0D 0A</code>",
            "<b class=\"faults\">hit by a fault</b> &lt;b&gt;<br>",
            "<td>30 ms</td></tr>",
            "<td>no reply</td></tr>",
            "data-at=\"1.000000\"",
            "<td>8</td><td>4</td><td>2</td><td>1</td><td>0</td><td>0</td><td>30 ms</td>",
        ] {
            assert!(html.contains(part), "{part}: {html}");
        }
        let times = talk.reply_times();
        assert_eq!(
            (&times[0].at, &times[0].values),
            (&vec![1.0, 2.0], &vec![Some(30.0), None],)
        );
    }
}
