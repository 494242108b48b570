//! The behaviour of the device in sentences.

use core::time::Duration;

use super::render::{Block, Page};
use crate::behaviour::{Deed, Trigger};
use crate::description::Description;
use crate::schema::behaviour::EventSpec;
use span::Span;

pub(super) fn tell(of: &Description, page: &mut Page) {
    let mut rows = Vec::new();
    for on in &of.on {
        let mut does = deed(of, &on.deed);
        does.extend(on.write.as_ref().map(|_| "writes registers".to_owned()));
        does.extend(on.busy.map(|busy| format!("is busy for {}", Span(busy))));
        does.extend(
            on.violation
                .map(|rule| format!("reports the violation {rule}")),
        );
        does.extend(on.restarts.then(|| "restarts".to_owned()));
        if does.is_empty() {
            does.push("does not reply".to_owned());
        }
        let time = if on.deed.send.is_empty() {
            String::new()
        } else {
            within(on.latency, on.jitter)
        };
        rows.push(vec![when(of, on.trigger, &on.deed), does.join(", "), time]);
    }
    for every in &of.every {
        let condition = condition(&every.deed);
        let begin = format!("every {}{condition}", Span(every.period));
        rows.push(vec![begin, deed(of, &every.deed).join(", "), String::new()]);
    }
    for after in &of.after {
        let when = format!("after {}", when(of, after.trigger, &after.deed));
        rows.push(vec![
            when,
            deed(of, &after.deed).join(", "),
            Span(after.delay).to_string(),
        ]);
    }
    if !rows.is_empty() {
        page.heading("Behaviour");
        page.add(Block::table(&["When", "The device", "After"], rows));
    }
    page.heading("Faults of the emulated device");
    let rows = of.faults().map(|(name, about)| {
        let about = if about.is_empty() {
            common(name)
        } else {
            about
        };
        vec![name.to_owned(), about.to_owned()]
    });
    page.add(Block::table(&["Fault", "Effect"], rows.collect()));
}

/// Faults that all described devices have.
fn common(name: &str) -> &'static str {
    match name {
        "off" => "the supply is gone",
        "restart" => "the device restarts",
        "stuck" => "measured values stay as they are",
        "garbage" => "random bytes instead of frames",
        "wrong" => "measured values times a factor",
        "slow" => "latencies times a factor",
        _ => "",
    }
}

fn within(latency: Duration, jitter: Option<Duration>) -> String {
    match jitter.filter(|jitter| !jitter.is_zero()) {
        None => Span(latency).to_string(),
        Some(jitter) => format!("{} to {}", Span(latency), Span(latency + jitter)),
    }
}

fn condition(deed: &Deed) -> String {
    let when = deed.when.as_ref();
    when.map_or_else(String::new, |when| format!(" if {}", when.source()))
}

fn when(of: &Description, trigger: Trigger, deed: &Deed) -> String {
    let what = match trigger {
        Trigger::Message(index) => of.messages[index].name.to_string(),
        Trigger::AnyMessage => "any message".to_owned(),
        Trigger::Event(event) => match event {
            EventSpec::BadFrame => "a damaged frame",
            EventSpec::Unknown => "an unknown message",
            EventSpec::Start => "the start",
            EventSpec::Watchdog => "the watchdog time",
            EventSpec::Break => "a break",
            EventSpec::Refused => "a refused register access",
        }
        .to_owned(),
    };
    what + &condition(deed)
}

fn deed(of: &Description, deed: &Deed) -> Vec<String> {
    let sets = deed.set.iter().map(|(variable, expr)| {
        format!("sets {} = {}", of.variables[*variable].name, expr.source())
    });
    let sends = deed
        .send
        .iter()
        .map(|index| format!("sends {}", of.messages[*index].name));
    sets.chain(sends).collect()
}
