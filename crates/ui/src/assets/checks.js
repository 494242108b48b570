// ---- the verdicts so far

// The first time in a text: digits with six decimals; only times are written with six decimals.
function firstTime(text) {
  const found = /(?<![\d.])\d+\.\d{6}(?![\d.])/.exec(text);
  return found ? Number(found[0]) : null;
}

const ORDER = ["fail", "open", "unseen", "pass"];
const STATES = { fail: "failed", open: "not yet", unseen: "nothing seen yet", pass: "holds" };

function showChecks() {
  const { checks, over } = seen().checks;
  if (!checks) return;
  const count = (state) => checks.filter((check) => check.state === state).length;
  const failed = count("fail"), held = count("pass");
  const verdict = failed ? "FAIL" : over ? held ? "PASS" : "nothing judged" : "PASS so far";
  const word = failed || over ? failed ? "fail" : "pass" : "open";
  const mark = { fail: "\u2717", pass: "\u2713", open: "\u2026" }[word];
  say("verdict", `${mark} ${verdict} ${held}/${checks.length}`);
  $("verdict").dataset.state = word;
  const ended = over ? "The run has come to its end: this is its verdict." : "As if it ended now.";
  say("so-far", `${held} hold, ${failed} failed, ${count("open")} not yet, ${count("unseen")} `
    + `with nothing seen. ${ended}`);
  once("checks", checks, () => {
    const sorted = [...checks].sort((a, b) => ORDER.indexOf(a.state) - ORDER.indexOf(b.state));
    return sorted.map(checkItem);
  });
}

function checkItem({ name, state, detail, meaning }) {
  const item = make("li", "", { className: state }), at = firstTime(detail);
  item.append(make("strong", name), ` ${STATES[state]}`, make("br"), detail, " ");
  if (at !== null) item.append(jump(at));
  if (meaning) item.append(make("small", meaning));
  return item;
}

$("verdict").onclick = () => showTab("checks");
