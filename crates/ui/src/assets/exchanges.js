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
      // The plots show the whole run at every displayed time.
      if (!isPast) hilrig.plots = told.plots;
      listTalk(told);
    })
    .catch(() => refuse("the rig does not answer the request for requests and replies"))
    .finally(() => { talkBusy = false; requestDraw(); });
}

const inMs = (value) => value === null ? "none" : `${value} ms`;

function listTalk({ talks, exchanges, listed_from_s, late_s }) {
  once("talks", talks, () => talks.map(talkRow));
  say("no-talk", late_s !== null
    ? `Bytes of this time are no longer kept: the figures count until ${late_s.toFixed(3)} s.`
    : !exchanges.length ? "No bytes yet. A program that opens the port of a "
      + "device, or an action of the scenario, starts the dialogue."
    : listed_from_s > 0 ? "The figures count from the start of the run, the list begins at "
      + `${listed_from_s.toFixed(3)} s.` : "");
  const box = $("exchanges-box"), atEnd = box.scrollTop + box.clientHeight >= box.scrollHeight - 20;
  listRows(exchanges, box);
  if (atEnd) box.scrollTop = box.scrollHeight;
}

// Unchanged rows are not rebuilt, so that they keep focus and selected text.
function listRows(exchanges, box) {
  const body = $("exchanges"), keys = exchanges.map((one) => JSON.stringify(one));
  const wanted = new Set(keys);
  for (const line of [...body.rows].filter((line) => !wanted.has(line.key))) {
    const hadFocus = line.contains(document.activeElement);
    line.remove();
    if (hadFocus) box.focus();
  }
  keys.forEach((key, index) => {
    const there = body.rows[index];
    if (there?.key === key) return;
    body.insertBefore(Object.assign(exchangeRow(exchanges[index]), { key }), there ?? null);
  });
}

// Figures of a link.
function talkRow(talk) {
  const since = talk.since_s === null ? "" : `, since ${talk.since_s.toFixed(3)} s`;
  return row([talk.link + since, talk.bytes_to_device, talk.bytes_to_master, talk.requests,
    talk.unanswered, talk.unasked, talk.bad, inMs(talk.reply_ms), inMs(talk.reply_ms_max)], [4, 6]);
}

// Words and bytes of a frame; the Wire tab shows long ones in full.
function frameCell(frame) {
  const cell = make("td");
  if (!frame) return cell;
  cell.className = [frame.is_bad && "bad", frame.is_hit && "hit"].filter(Boolean).join(" ");
  const hex = frame.bytes.length > 64 ? `${frame.bytes.slice(0, 64)}..` : frame.bytes;
  const words = frame.words.length > 300 ? `${frame.words.slice(0, 300)} ..` : frame.words;
  cell.append(make("span", words), make("code", spaced(hex)));
  return cell;
}

function exchangeRow({ link, request, reply, reply_ms }) {
  const line = make("tr"), when = make("td"), first = request ?? reply;
  when.append(jump(first.at_ns / 1e9));
  const isOpen = request && !request.is_bad && !reply;
  const time = isOpen ? "no reply" : reply_ms === null ? "" : `${reply_ms} ms`;
  line.append(when, make("td", link), frameCell(request), frameCell(reply),
    make("td", time, { className: isOpen ? "bad" : "" }));
  return line;
}
