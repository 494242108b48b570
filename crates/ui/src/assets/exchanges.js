// ---- a run without a robot: requests, replies and their times in place of a map

let talkAsked = 0, talkBusy = false;

// Requests the newest exchanges up to the displayed time.
function showTalk() {
  if (hilrig.stage.body !== false) return;
  const time = performance.now(), isPast = Boolean(hilrig.past), at_ns = seen().now.at_ns;
  const key = `${at_ns} ${isPast}`;
  if (talkBusy || shown.talk === key || !hilrig.now.paused && time - talkAsked < 400) return;
  [talkBusy, talkAsked, shown.talk] = [true, time, key];
  fetch(`/exchanges${query(`&at_ns=${at_ns}`)}`)
    .then((reply) => reply.json())
    .then((told) => {
      hilrig.talk = told;
      // The plots have the whole run, whatever time is shown.
      if (!isPast) hilrig.plots = told.plots;
      listTalk(told);
    })
    .catch(() => refuse("the rig does not answer the request for requests and replies"))
    .finally(() => { talkBusy = false; requestDraw(); });
}

const inMs = (value) => value === null ? "none" : `${value} ms`;

function listTalk({ talks, exchanges }) {
  once("talks", talks, () => talks.map(talkRow));
  say("no-talk", exchanges.length ? "" : "No bytes yet. A program that opens the port of a "
    + "device, or an action of the scenario, starts the dialogue.");
  const box = $("exchanges-box"), atEnd = box.scrollTop + box.clientHeight >= box.scrollHeight - 20;
  const body = $("exchanges"), key = JSON.stringify(exchanges);
  if (shown.exchanges !== key) {
    shown.exchanges = key;
    const hadFocus = body.contains(document.activeElement);
    body.replaceChildren(...exchanges.map(exchangeRow));
    if (hadFocus) box.focus();
  }
  if (atEnd) box.scrollTop = box.scrollHeight;
}

// Figures of a link.
function talkRow(talk) {
  return row([talk.link, talk.bytes_to_device, talk.bytes_to_master, talk.requests,
    talk.unanswered, talk.unasked, talk.bad, inMs(talk.reply_ms), inMs(talk.reply_ms_max)], [4, 6]);
}

// Words and bytes of a frame; the Wire tab has the longer ones in full.
function frameCell(frame) {
  const cell = make("td");
  if (!frame) return cell;
  cell.className = [frame.is_bad && "bad", frame.is_hit && "hit"].filter(Boolean).join(" ");
  const hex = frame.bytes.length > 64 ? `${frame.bytes.slice(0, 64)}..` : frame.bytes;
  cell.append(make("span", frame.words), make("code", spaced(hex)));
  return cell;
}

function exchangeRow({ link, request, reply, reply_ms }) {
  const line = make("tr"), when = make("td"), first = request ?? reply;
  when.append(jump(first.at_ns / 1e9));
  const time = request ? reply ? `${reply_ms} ms` : "no reply" : "";
  line.append(when, make("td", link), frameCell(request), frameCell(reply),
    make("td", time, { className: request && !reply ? "bad" : "" }));
  return line;
}
