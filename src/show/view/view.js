// Drawing of world, map, ways, scan, waypoints and wire lanes on a canvas, from plain JSON: shared
// by the live page and by report.html. A classic script without dependencies; it adds one object,
// `hilrigView`, and touches nothing but the canvas or element it is given. The JSON (metres,
// radians, seconds):
//
//   frame      {x, y, scale, height}       what `fit` makes; pass it to everything else
//   scene      {bounds: [x0, y0, x1, y1], shapes: [SHAPE..]}
//   SHAPE      {wall: [x0, y0, x1, y1]} | {polygon: [x0, y0, x1, y1, ..]} | {circle: [x, y, r]}
//   map        {width, height, resolution_m, origin_m, cells}   cells: bytes, lowest row first,
//              255 = wall; origin_m: corner of least x and y, 0, 0 if left out
//   layer      "raw" | "walls" | "known"
//   footprint  SHAPE in the robot's own axes: x ahead, y to the left
//   overlay    {name, role: "sensed" | "possible" | "planned" | "guess" | "mark",
//              lines: [path..], points: [x0, y0, x1, y1, ..]}
//   path       [x0, y0, x1, y1, ..]
//   pose       [x, y, theta]
//   scan       [x0, y0, x1, y1, ..]        where beams ended, in the world's frame
//   waypoints  [x0, y0, x1, y1, ..]        in the order of their visit
//   lane       {name, load: [0..1 per bin], errors: [n per bin], faults: [n per bin]}
//   mark       {at, kind: "event" | "violation" | "fail" | "fault"}
"use strict";
const hilrigView = (() => {
  const colours = {
    paper: "#ffffff", ink: "#1b1f24", faint: "#c9d1d9", unknown: 127,
    shape: "#8a5a00", truth: "#00813c", belief: "#c62828", scan: "#0a62c9", waypoint: "#6a1b9a",
    sensed: "#0a62c9", possible: "#6b7580", planned: "#6a1b9a", guess: "#c62828",
    mark: "#a35200",
    load: "#0a62c9", errors: "#c62828", faults: "#e07b00", cursor: "#1b1f24",
  };

  // A frame that shows `bounds` whole, with y upwards.
  function fit(canvas, bounds, margin = 8) {
    const [x0, y0, x1, y1] = bounds;
    const wide = Math.max(x1 - x0, 1e-6), high = Math.max(y1 - y0, 1e-6);
    const scale = Math.min((canvas.width - 2 * margin) / wide,
                           (canvas.height - 2 * margin) / high);
    return {
      x: x0 - (canvas.width / scale - wide) / 2,
      y: y0 - (canvas.height / scale - high) / 2,
      scale, height: canvas.height,
    };
  }

  // Pixel of a place, and place of a pixel.
  const toPixel = (frame, x, y) =>
    [(x - frame.x) * frame.scale, frame.height - (y - frame.y) * frame.scale];
  const toWorld = (frame, px, py) =>
    [px / frame.scale + frame.x, (frame.height - py) / frame.scale + frame.y];

  function clear(context) {
    context.fillStyle = colours.paper;
    context.fillRect(0, 0, context.canvas.width, context.canvas.height);
  }

  function line(context, frame, path, closed) {
    context.beginPath();
    for (let i = 0; i + 1 < path.length; i += 2) {
      const [x, y] = toPixel(frame, path[i], path[i + 1]);
      if (i === 0) context.moveTo(x, y); else context.lineTo(x, y);
    }
    if (closed) context.closePath();
  }

  function drawWorld(context, frame, scene) {
    context.strokeStyle = colours.shape;
    context.fillStyle = "rgba(138, 90, 0, 0.18)";
    context.lineWidth = 1.5;
    for (const shape of scene.shapes) {
      if (shape.wall) {
        line(context, frame, shape.wall, false);
      } else if (shape.polygon) {
        line(context, frame, shape.polygon, true);
      } else if (shape.circle) {
        const [x, y, r] = shape.circle;
        const [px, py] = toPixel(frame, x, y);
        context.beginPath();
        context.arc(px, py, r * frame.scale, 0, 2 * Math.PI);
        context.fill();
      }
      context.stroke();
    }
  }

  // Whether a cell is part of a wall: the rule by which runs are scored.
  function isWall(map, x, y) {
    const at = (x, y) => x < 0 || y < 0 || x >= map.width || y >= map.height
      ? colours.unknown : map.cells[y * map.width + x];
    const here = at(x, y);
    const ridge = (dx, dy) => here >= at(x - dx, y - dy) && here >= at(x + dx, y + dy)
      && here > at(x - 3 * dx, y - 3 * dy) && here > at(x + 3 * dx, y + 3 * dy);
    return here >= 190 && (ridge(1, 0) || ridge(0, 1));
  }

  function shade(map, layer, x, y) {
    const value = map.cells[y * map.width + x];
    if (layer === "walls") return isWall(map, x, y) ? 0 : 255;
    if (layer === "known") return Math.abs(value - colours.unknown) < 12 ? 200 : 255;
    return 255 - value;
  }

  // The map as a picture of one pixel a cell, top row first: to be kept and drawn again.
  function mapImage(map, layer) {
    const image = new ImageData(map.width, map.height);
    for (let y = 0; y < map.height; y++) {
      for (let x = 0; x < map.width; x++) {
        const value = shade(map, layer, x, y);
        const at = ((map.height - 1 - y) * map.width + x) * 4;
        image.data.set([value, value, value, 255], at);
      }
    }
    const canvas = document.createElement("canvas");
    canvas.width = map.width;
    canvas.height = map.height;
    canvas.getContext("2d").putImageData(image, 0, 0);
    return canvas;
  }

  // `image`: of `mapImage`. The map's lower left corner is the world's origin.
  function drawMap(context, frame, map, image) {
    const [left, low] = map.origin_m ?? [0, 0];
    const [x, y] = toPixel(frame, left, low + map.height * map.resolution_m);
    context.imageSmoothingEnabled = false;
    context.drawImage(image, x, y, map.width * map.resolution_m * frame.scale,
                      map.height * map.resolution_m * frame.scale);
  }

  function drawPath(context, frame, path, colour) {
    context.strokeStyle = colour;
    context.lineWidth = 2;
    line(context, frame, path, false);
    context.stroke();
  }

  function drawScan(context, frame, scan) {
    context.fillStyle = colours.scan;
    for (let i = 0; i + 1 < scan.length; i += 2) {
      const [x, y] = toPixel(frame, scan[i], scan[i + 1]);
      context.fillRect(x - 1, y - 1, 2, 2);
    }
  }

  // Corners of a footprint where a robot at `pose` has them.
  function placed(corners, [x, y, theta]) {
    const cos = Math.cos(theta), sin = Math.sin(theta), path = [];
    for (let i = 0; i + 1 < corners.length; i += 2) {
      const [ahead, left] = [corners[i], corners[i + 1]];
      path.push(x + ahead * cos - left * sin, y + ahead * sin + left * cos);
    }
    return path;
  }

  // The robot's outline, and where it looks; a dot's size at least.
  function drawRobot(context, frame, pose, footprint, colour) {
    const [x, y] = toPixel(frame, pose[0], pose[1]), corners = footprint.polygon;
    // As far as it reaches ahead.
    const ahead = corners ? Math.max(...corners.filter((_, i) => i % 2 === 0))
      : footprint.circle[2];
    const r = Math.max(ahead * frame.scale, 4);
    context.strokeStyle = colour;
    context.lineWidth = 2;
    if (corners && r > 4) {
      line(context, frame, placed(corners, pose), true);
    } else {
      context.beginPath();
      context.arc(x, y, r, 0, 2 * Math.PI);
    }
    context.moveTo(x, y);
    context.lineTo(x + 1.3 * r * Math.cos(pose[2]), y - 1.3 * r * Math.sin(pose[2]));
    context.stroke();
  }

  // Lines thin where there may be many of them, thick where they are a plan; points as dots.
  function drawOverlay(context, frame, overlay) {
    context.strokeStyle = context.fillStyle = colours[overlay.role];
    context.lineWidth = overlay.role === "planned" ? 3 : overlay.role === "possible" ? 0.5 : 1.5;
    for (const path of overlay.lines) {
      line(context, frame, path, false);
      context.stroke();
    }
    const r = overlay.role === "possible" ? 1.5 : 4;
    for (let i = 0; i + 1 < overlay.points.length; i += 2) {
      const [x, y] = toPixel(frame, overlay.points[i], overlay.points[i + 1]);
      context.beginPath();
      context.arc(x, y, r, 0, 2 * Math.PI);
      context.fill();
    }
  }

  // A switch for each overlay there is or was, in `parent`. Names that are off are in `hidden`.
  function offerOverlays(parent, overlays, hidden, changed) {
    for (const { name, role } of overlays) {
      if ([...parent.children].some((label) => label.dataset.name === name)) continue;
      const label = document.createElement("label"), box = document.createElement("input");
      box.type = "checkbox";
      box.checked = !hidden.has(name);
      box.addEventListener("change", () => {
        hidden[box.checked ? "delete" : "add"](name);
        changed();
      });
      label.dataset.name = name;
      label.style.color = colours[role];
      label.append(box, ` ${name}`);
      parent.append(label, " ");
    }
  }

  // Numbered from 1 and joined; the first `reached` are pale.
  function drawWaypoints(context, frame, waypoints, reached = 0) {
    context.setLineDash([4, 4]);
    drawPath(context, frame, waypoints, colours.waypoint);
    context.setLineDash([]);
    context.font = "bold 12px sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    for (let i = 0; i + 1 < waypoints.length; i += 2) {
      const [x, y] = toPixel(frame, waypoints[i], waypoints[i + 1]);
      context.beginPath();
      context.arc(x, y, 9, 0, 2 * Math.PI);
      context.fillStyle = i / 2 < reached ? "#b794c9" : colours.waypoint;
      context.fill();
      context.fillStyle = "#ffffff";
      context.fillText(String(i / 2 + 1), x, y + 0.5);
    }
  }

  const labelWidth = 130, laneHeight = 26;

  // Pixel of a time on lanes from `from` to `to`, and back.
  const timeToPixel = (canvas, from, to, at) =>
    labelWidth + (at - from) / Math.max(to - from, 1e-9) * (canvas.width - labelWidth);
  const pixelToTime = (canvas, from, to, x) => Math.min(to, Math.max(from,
    from + (x - labelWidth) / (canvas.width - labelWidth) * (to - from)));

  // One row a lane: load as bars, errors (red) and faults (orange) as ticks; `marks` on top of all;
  // `at` is the cursor. Returns the height that was needed.
  function drawLanes(context, lanes, from, to, marks = [], at = null) {
    const canvas = context.canvas;
    context.font = "12px sans-serif";
    context.textBaseline = "middle";
    context.textAlign = "left";
    lanes.forEach((lane, row) => {
      const top = row * laneHeight, bottom = top + laneHeight - 4;
      context.fillStyle = colours.ink;
      context.fillText(lane.name, 2, (top + bottom) / 2, labelWidth - 6);
      context.fillStyle = colours.faint;
      context.fillRect(labelWidth, bottom, canvas.width - labelWidth, 1);
      const width = (canvas.width - labelWidth) / Math.max(lane.load.length, 1);
      const bar = (i, share, colour, high) => {
        context.fillStyle = colour;
        context.fillRect(labelWidth + i * width, bottom - share * high, Math.max(width, 1),
                         share * high);
      };
      // What is little is still to be seen.
      const share = (load) => load > 0 ? Math.max(Math.min(load, 1), 0.06) : 0;
      lane.load.forEach((load, i) => bar(i, share(load), colours.load, bottom - top));
      (lane.errors || []).forEach((count, i) => { if (count) bar(i, 1, colours.errors, 8); });
      (lane.faults || []).forEach((count, i) => { if (count) bar(i, 1, colours.faults, 14); });
    });
    const high = lanes.length * laneHeight;
    for (const mark of marks) {
      const x = timeToPixel(canvas, from, to, mark.at);
      context.fillStyle = mark.kind === "event" ? colours.ink
        : mark.kind === "fault" ? colours.faults : colours.errors;
      context.fillRect(x - 0.5, high, 1.5, laneHeight - 6);
    }
    if (at !== null) {
      context.fillStyle = colours.cursor;
      context.fillRect(timeToPixel(canvas, from, to, at) - 1, 0, 2, high + laneHeight);
    }
    return high + laneHeight;
  }

  // Bytes of hexadecimal digits.
  const bytes = (text) => Uint8Array.from({ length: text.length / 2 },
    (_, i) => parseInt(text.slice(2 * i, 2 * i + 2), 16));

  // The cells of a map from pairs of count and value.
  function cells(runs, count) {
    const cells = new Uint8Array(count);
    for (let i = 0, at = 0; i + 1 < runs.length; at += runs[i], i += 2) {
      cells.fill(runs[i + 1], at, at + runs[i]);
    }
    return cells;
  }

  // The cells of a map of 16 shades: runs of 1 to 16 in the upper half, the shade in the lower.
  function shades(runs, count) {
    const cells = new Uint8Array(count);
    let at = 0;
    for (const run of runs) cells.fill((run & 15) * 17, at, at += (run >> 4) + 1);
    return cells;
  }

  // A picture from runs of count, red, green, blue: fills the canvas.
  function drawPicture(canvas, width, height, runs) {
    canvas.width = width;
    canvas.height = height;
    const image = new ImageData(width, height);
    for (let i = 0, at = 0; i + 3 < runs.length; i += 4) {
      for (let left = runs[i]; left > 0; left--, at += 4) {
        image.data.set([runs[i + 1], runs[i + 2], runs[i + 3], 255], at);
      }
    }
    canvas.getContext("2d").putImageData(image, 0, 0);
  }

  return {
    colours, fit, toPixel, toWorld, clear, drawWorld, mapImage, drawMap, drawPath, drawScan,
    drawRobot, drawOverlay, offerOverlays, drawWaypoints, drawLanes, timeToPixel, pixelToTime,
    laneHeight, bytes, cells, shades, drawPicture,
  };
})();
