// The time line of a run on a canvas: the load of the wires, faults and events, and figures as
// plots, all over one axis of time. Shared by the live page and report.html; a classic script that
// needs view.js and adds one object, `hilrigLanes`. Times are seconds.
//
//   model   {from, to, links: [LINK..], bars: [BAR..], marks: [MARK..], plots: [PLOT..], cursor}
//   LINK    {name, ways: [LANE to-master, LANE to-device]}     one above the other
//   LANE    {at: [end of each bin..], load: [0..1..], errors: [n..], faults: [n..],
//            damage: [[from, to | null]..]}      while faults act on it
//   BAR     {name, from, to | null, isOver}       a fault and its duration
//   MARK    {at, kind: "event" | "violation" | "fail" | "fault" | "visit"}
//   PLOT    {name, unit, at: [s..], values: [number | null..]}
"use strict";
const hilrigLanes = (() => {
  const { colours } = hilrigView;
  const ruler = 18, lane = 11, link = 2 * lane + 2, bar = 15, marks = 17, plot = 54;
  const labels = (width) => width < 600 ? 112 : 156;

  // Pixel of a time on a time line of `width`, and back.
  const toPixel = ({ from, to }, width, at) =>
    labels(width) + (at - from) / Math.max(to - from, 1e-9) * (width - labels(width) - 8);
  const toTime = ({ from, to }, width, x) =>
    from + (x - labels(width)) / Math.max(width - labels(width) - 8, 1) * (to - from);

  // Bars side by side in as few rows as they need.
  function stacked(bars) {
    const rows = [];
    for (const one of bars) {
      const free = rows.find((row) => (row[row.length - 1].to ?? Infinity) < one.from);
      if (free) free.push(one); else rows.push([one]);
    }
    return rows.slice(0, 6);
  }

  const height = (model) => ruler + marks + model.links.length * link
    + stacked(model.bars).length * bar + model.plots.length * plot + 4;

  // 00:22.812; hours only where there are some.
  function clock(seconds, digits = 3) {
    const whole = Math.floor(seconds / 60), hours = Math.floor(whole / 60);
    const two = (number) => String(number).padStart(2, "0");
    const rest = (seconds - whole * 60).toFixed(digits).padStart(digits ? 3 + digits : 2, "0");
    return `${hours ? `${hours}:${two(whole % 60)}` : two(whole)}:${rest}`;
  }

  // A step of time that leaves room for a label.
  function step(span, count) {
    const steps = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60,
      120, 300, 600, 1200, 1800, 3600, 7200, 14400, 43200, 86400];
    return steps.find((one) => span / one <= count) ?? 86400 * 7;
  }

  // The range of indices of sorted `at` that are visible, one more on either side.
  function seen(at, { from, to }) {
    const after = (time) => {
      let low = 0, high = at.length;
      while (low < high) {
        const middle = (low + high) >> 1;
        if (at[middle] < time) low = middle + 1; else high = middle;
      }
      return low;
    };
    return [Math.max(after(from) - 1, 0), Math.min(after(to) + 1, at.length)];
  }

  function drawRuler(context, model, width, high) {
    const [digits, span] = [model.to - model.from < 10 ? 1 : 0, model.to - model.from];
    const every = step(span, Math.max((width - labels(width)) / 80, 1));
    context.fillStyle = colours.dim;
    context.textAlign = "center";
    for (let at = Math.ceil(model.from / every) * every; at <= model.to; at += every) {
      const x = Math.round(toPixel(model, width, at));
      context.fillStyle = colours.grid;
      context.fillRect(x, ruler - 2, 1, high - ruler);
      context.fillStyle = colours.dim;
      const text = clock(at, every < 0.1 ? 3 : digits);
      context.fillText(text, Math.min(x, width - context.measureText(text).width / 2 - 2), 8);
    }
    context.textAlign = "left";
  }

  // Draws the busiest bin of each column, so that a long run is drawn as quickly as a short one.
  function drawLane(context, model, width, top, one) {
    const bottom = top + lane - 1, left = labels(width);
    context.fillStyle = colours.grid;
    context.fillRect(left, bottom, width - left - 8, 0.5);
    for (const [from, to] of one.damage ?? []) {
      const x = Math.max(toPixel(model, width, from), left);
      const end = Math.min(toPixel(model, width, to ?? model.to), width - 8);
      context.fillStyle = colours.faults;
      context.globalAlpha = 0.3;
      if (end > x) context.fillRect(x, top, Math.max(end - x, 2), lane);
      context.globalAlpha = 1;
    }
    let column = -1, best = [0, 0, 0];
    const flush = (wide) => {
      if (column < 0) return;
      // A small load stays visible.
      const load = best[0] > 0 ? Math.max(Math.min(best[0], 1), 0.14) * (lane - 2) : 0;
      const piece = (colour, high) => {
        context.fillStyle = colour;
        context.fillRect(column, bottom - high, wide, high);
      };
      if (load) piece(colours.load, load);
      if (best[2]) piece(colours.faults, lane - 2);
      if (best[1]) piece(colours.errors, 4);
    };
    const [first, last] = seen(one.at, model);
    for (let i = Math.max(first, 0); i < last; i++) {
      const start = i ? one.at[i - 1] : 0;
      const x = Math.floor(Math.max(toPixel(model, width, Math.max(start, model.from)), left));
      if (x > width - 8) break;
      if (x !== column) { flush(Math.max(x - column, 1)); column = x; best = [0, 0, 0]; }
      best = [one.load[i], one.errors?.[i] ?? 0, one.faults?.[i] ?? 0]
        .map((value, k) => Math.max(value, best[k]));
    }
    const end = one.at.length ? toPixel(model, width, Math.min(one.at[last - 1], model.to)) : 0;
    flush(Math.max(Math.floor(end) - column, 1));
  }

  function drawBar(context, model, width, top, one) {
    const left = labels(width), right = width - 8;
    const x = Math.max(toPixel(model, width, one.from), left);
    const end = Math.min(toPixel(model, width, one.to ?? model.to), right);
    if (end < left || x > right) return;
    context.fillStyle = colours.faults;
    context.globalAlpha = one.isOver ? 0.55 : 1;
    context.fillRect(x, top + 1, Math.max(end - x, 2), bar - 3);
    context.globalAlpha = 1;
    const wide = context.measureText(one.name).width;
    const room = end - x > wide + 6;
    context.fillStyle = room ? "#1b1f24" : colours.ink;
    const place = room ? x + 3 : end + wide + 6 < right ? end + 4 : x - wide - 4;
    context.fillText(one.name, Math.max(place, left), top + bar / 2);
  }

  // A tick for each mark, a higher one for all but plain events; a failed check is a cross.
  function drawMarks(context, model, width, top) {
    const kinds = {
      event: [colours.dim, 5], visit: [colours.waypoint, 11], fault: [colours.faults, 11],
      violation: [colours.errors, 11], fail: [colours.errors, 13],
    };
    for (const { at, kind } of model.marks) {
      if (at < model.from || at > model.to) continue;
      const x = toPixel(model, width, at), [colour, high] = kinds[kind];
      context.fillStyle = context.strokeStyle = colour;
      if (kind !== "fail") {
        context.fillRect(x - 0.75, top + marks - 3 - high, 1.5, high);
        continue;
      }
      context.lineWidth = 2;
      context.beginPath();
      context.moveTo(x - 4, top + 3); context.lineTo(x + 4, top + 11);
      context.moveTo(x + 4, top + 3); context.lineTo(x - 4, top + 11);
      context.stroke();
    }
  }

  const figure = (value) => Math.abs(value) >= 1000 ? value.toFixed(0)
    : String(Math.round(value * 1000) / 1000);

  // The value of a plot at a time: the last known one.
  function valueAt(one, at) {
    const [, end] = seen(one.at, { from: 0, to: at });
    for (let i = Math.min(end, one.at.length) - 1; i >= 0; i--) {
      if (one.at[i] <= at && one.values[i] !== null && one.values[i] !== undefined) {
        return one.values[i];
      }
    }
    return null;
  }

  function drawPlot(context, model, width, top, one, colour) {
    const left = labels(width), low = top + plot - 8, high = top + 6;
    const [first, last] = seen(one.at, model);
    let min = Infinity, max = -Infinity;
    for (let i = first; i < last; i++) {
      const value = one.values[i];
      if (value === null || value === undefined) continue;
      min = Math.min(min, value);
      max = Math.max(max, value);
    }
    context.fillStyle = colours.grid;
    context.fillRect(left, low + 3, width - left - 8, 1);
    const isKnown = min <= max;
    const now = valueAt(one, model.cursor ?? model.to);
    context.fillStyle = colours.ink;
    context.fillText(one.name, 2, top + 14, left - 8);
    context.fillStyle = colours.dim;
    const shown = now === null ? "" : `${figure(now)} ${one.unit}`;
    context.fillText(shown, 2, top + 30, left - 8);
    if (!isKnown) return;
    const span = max - min || 1;
    const y = (value) => low - (value - min) / span * (low - high);
    // Beside the plot, or inside it if there is no room.
    const narrow = width < 600, edge = narrow ? left + 3 : left - 4;
    context.textAlign = narrow ? "left" : "right";
    context.fillText(figure(max), edge, high + 4);
    if (max > min) context.fillText(figure(min), edge, low - 2);
    context.textAlign = "left";
    context.strokeStyle = colour;
    context.lineWidth = 1.5;
    context.save();
    context.beginPath();
    context.rect(left, top, width - left - 8, plot);
    context.clip();
    context.beginPath();
    let down = false;
    for (let i = first; i < last; i++) {
      const value = one.values[i];
      if (value === null || value === undefined) { down = false; continue; }
      const x = toPixel(model, width, one.at[i]);
      if (down) context.lineTo(x, y(value)); else context.moveTo(x, y(value));
      down = true;
    }
    context.stroke();
    // A value without neighbours is drawn as a dot.
    context.fillStyle = colour;
    const known = (i) => one.values[i] !== null && one.values[i] !== undefined;
    for (let i = first; i < last; i++) {
      if (!known(i) || known(i - 1) || known(i + 1)) continue;
      context.fillRect(toPixel(model, width, one.at[i]) - 2, y(one.values[i]) - 2, 4, 4);
    }
    context.restore();
  }

  // Fills the canvas: `width` pixels of its style, and `ratio` device pixels for each of them.
  function draw(canvas, model, width, ratio) {
    const high = height(model), context = canvas.getContext("2d"), left = labels(width);
    const sizes = [Math.round(width * ratio), Math.round(high * ratio)];
    if (canvas.width !== sizes[0]) canvas.width = sizes[0];
    if (canvas.height !== sizes[1]) canvas.height = sizes[1];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = colours.paper;
    context.fillRect(0, 0, width, high);
    context.font = "12px system-ui, sans-serif";
    context.textBaseline = "middle";
    drawRuler(context, model, width, high);
    const name = (text, top, tall) => {
      context.fillStyle = colours.ink;
      context.fillText(text, 2, top + tall / 2, left - 6);
    };
    let top = ruler;
    name("events", top, marks);
    drawMarks(context, model, width, top);
    top += marks;
    stacked(model.bars).forEach((row, index) => {
      if (index === 0) name("faults", top, bar);
      for (const one of row) drawBar(context, model, width, top, one);
      top += bar;
    });
    for (const { name: called, ways } of model.links) {
      context.font = "11px system-ui, sans-serif";
      ways.forEach((one, index) => {
        context.fillStyle = index ? colours.dim : colours.ink;
        const words = `${called} ${index ? "to-device" : "to-master"}`;
        context.fillText(words, 2, top + lane * (index + 0.5), left - 6);
        drawLane(context, model, width, top + lane * index, one);
      });
      top += link;
    }
    context.font = "12px system-ui, sans-serif";
    model.plots.forEach((one, index) => {
      const palette = [colours.truth, colours.belief, colours.scan, colours.waypoint];
      drawPlot(context, model, width, top, one, palette[index % palette.length]);
      top += plot;
    });
    if (model.cursor !== null && model.cursor >= model.from && model.cursor <= model.to) {
      context.fillStyle = colours.cursor;
      context.fillRect(toPixel(model, width, model.cursor) - 1, ruler - 4, 2, high - ruler);
    }
    return high;
  }

  return { draw, height, toPixel, toTime, valueAt, clock };
})();
