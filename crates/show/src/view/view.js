// Drawing of world, map, ways, scan and waypoints on a canvas, from plain JSON: shared by the live
// page and by report.html. A classic script without dependencies; it adds one object,
// `hilrigView`, and touches nothing but the canvas or element it is given. The JSON (metres,
// radians, seconds):
//
//   frame      {x, y, scale, height}       made by `fit`; pass it to all other functions
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
"use strict";
const hilrigView = (() => {
  // Colours that colour-blind people can distinguish (Okabe and Ito); `setDark` changes the others.
  const colours = {
    unknown: 127, truth: "#009e73", belief: "#d55e00", scan: "#0072b2", waypoint: "#cc79a7",
    sensed: "#0072b2", planned: "#cc79a7", guess: "#d55e00",
  };
  const light = {
    paper: "#ffffff", ink: "#1b1f24", dim: "#57606a", grid: "#d8dee4", shape: "#8a5a00",
    shapeIn: "rgba(138, 90, 0, 0.18)", possible: "#6b7580", mark: "#a35200", load: "#0072b2",
    errors: "#b3261e", faults: "#b87a00", cursor: "#1b1f24",
    tones: [[255, 255, 255], [190, 196, 203], [0, 0, 0]],
  };
  const dark = {
    paper: "#16191d", ink: "#e6e6e6", dim: "#a9b1ba", grid: "#30363d", shape: "#d9a441",
    shapeIn: "rgba(217, 164, 65, 0.2)", possible: "#8b949e", mark: "#ffb74d", load: "#4aa3df",
    errors: "#ff8a80", faults: "#e69f00", cursor: "#e6e6e6",
    tones: [[34, 38, 43], [74, 80, 88], [230, 230, 230]],
  };
  // Drawn parts in these colours have a contrast of at least 3 against the paper.
  const setDark = (isDark) => Object.assign(colours, isDark ? dark : light, { isDark });
  setDark(false);

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
    context.fillStyle = colours.shapeIn;
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

  // The probability of a wall, from 0 (free) to 255.
  function shade(map, layer, x, y) {
    const value = map.cells[y * map.width + x];
    if (layer === "walls") return isWall(map, x, y) ? 255 : 0;
    if (layer === "known") return Math.abs(value - colours.unknown) < 12 ? colours.unknown : 0;
    return value;
  }

  // The colour of a shade: from free over unknown to wall.
  function tone(value) {
    const [free, unknown, wall] = colours.tones, middle = colours.unknown;
    const [a, b, share] = value <= middle ? [free, unknown, value / middle]
      : [unknown, wall, (value - middle) / (255 - middle)];
    return a.map((from, i) => from + (b[i] - from) * share);
  }

  // The map as a picture of one pixel a cell, top row first. It can be stored and drawn again.
  function mapImage(map, layer) {
    const image = new ImageData(map.width, map.height);
    const tones = Array.from({ length: 256 }, (_, value) => tone(value));
    for (let y = 0; y < map.height; y++) {
      for (let x = 0; x < map.width; x++) {
        const [red, green, blue] = tones[shade(map, layer, x, y)];
        const at = ((map.height - 1 - y) * map.width + x) * 4;
        image.data[at] = red;
        image.data[at + 1] = green;
        image.data[at + 2] = blue;
        image.data[at + 3] = 255;
      }
    }
    const canvas = document.createElement("canvas");
    canvas.width = map.width;
    canvas.height = map.height;
    canvas.getContext("2d").putImageData(image, 0, 0);
    return canvas;
  }

  // `image` comes from `mapImage`. Without `origin_m` the map's lower left corner is 0, 0.
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

  // Corners of the footprint of a robot at `pose`, in the world.
  function placed(corners, [x, y, theta]) {
    const cos = Math.cos(theta), sin = Math.sin(theta), path = [];
    for (let i = 0; i + 1 < corners.length; i += 2) {
      const [ahead, left] = [corners[i], corners[i + 1]];
      path.push(x + ahead * cos - left * sin, y + ahead * sin + left * cos);
    }
    return path;
  }

  // The robot's outline and its heading, at least as large as a dot.
  function drawRobot(context, frame, pose, footprint, colour) {
    const [x, y] = toPixel(frame, pose[0], pose[1]), corners = footprint.polygon;
    // Distance from the centre to the front.
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

  // Thin lines for kinds that can be numerous, thick lines for plans; points as dots.
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

  // A switch in `parent` for each present or earlier overlay. Names that are off are in `hidden`.
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
      const sample = document.createElement("i");
      label.dataset.name = name;
      sample.className = `sample ${role}`;
      label.append(box, sample, name);
      parent.append(label, " ");
    }
  }

  // Waypoints whose numbers would cover each other, as one mark: [[x, y, indices]..] in pixels.
  function clustered(frame, waypoints) {
    const marks = [];
    for (let i = 0; i + 1 < waypoints.length; i += 2) {
      const [x, y] = toPixel(frame, waypoints[i], waypoints[i + 1]);
      const near = marks.find((mark) => Math.hypot(mark[0] - x, mark[1] - y) < 17);
      if (near) near[2].push(i / 2); else marks.push([x, y, [i / 2]]);
    }
    return marks;
  }

  // Indices from 0 as "1, 4"; a long list is cut.
  const numbers = (indices) => indices.length > 4
    ? `${indices.slice(0, 3).map((one) => one + 1).join(", ")}, ..`
    : indices.map((one) => one + 1).join(", ");

  // Waypoints, numbered from 1 and joined. `reached` ones are pale, the `marked` one has a ring.
  function drawWaypoints(context, frame, waypoints, reached = [], marked = null) {
    context.setLineDash([4, 4]);
    drawPath(context, frame, waypoints, colours.waypoint);
    context.setLineDash([]);
    context.font = "bold 12px sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    for (const [x, y, indices] of clustered(frame, waypoints)) {
      const text = numbers(indices), half = Math.max(context.measureText(text).width / 2 + 5, 9);
      const outline = (more) => {
        context.beginPath();
        context.roundRect(x - half - more, y - 9 - more, 2 * (half + more), 18 + 2 * more,
                          9 + more);
      };
      if (indices.includes(marked)) {
        outline(4);
        context.strokeStyle = colours.ink;
        context.lineWidth = 3;
        context.stroke();
      }
      outline(0);
      context.globalAlpha = indices.every((index) => reached[index]) ? 0.5 : 1;
      context.fillStyle = colours.waypoint;
      context.fill();
      context.globalAlpha = 1;
      context.fillStyle = "#000000";
      context.fillText(text, x, y + 0.5);
    }
  }

  // A grid, whose spacing depends on the scale, and a bar with its length.
  function drawGrid(context, frame, ratio) {
    const { width, height } = context.canvas;
    const lengths = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];
    const every = lengths.find((one) => one * frame.scale >= 56 * ratio) ?? 1000;
    context.globalAlpha = 0.35;
    context.fillStyle = colours.dim;
    const [x0, y0] = toWorld(frame, 0, height), [x1, y1] = toWorld(frame, width, 0);
    for (let x = Math.ceil(x0 / every) * every; x < x1; x += every) {
      context.fillRect(Math.round(toPixel(frame, x, 0)[0]), 0, ratio / 2, height);
    }
    for (let y = Math.ceil(y0 / every) * every; y < y1; y += every) {
      context.fillRect(0, Math.round(toPixel(frame, 0, y)[1]), width, ratio / 2);
    }
    context.globalAlpha = 1;
    const long = every * frame.scale, left = 14 * ratio, low = height - 12 * ratio;
    context.fillStyle = colours.paper;
    context.fillRect(left - 6 * ratio, low - 20 * ratio, long + 12 * ratio, 26 * ratio);
    context.fillStyle = colours.ink;
    context.fillRect(left, low, long, 2 * ratio);
    context.font = `${12 * ratio}px system-ui, sans-serif`;
    context.textAlign = "left";
    context.textBaseline = "bottom";
    const length = every >= 1 ? `${every} m` : `${Math.round(every * 100)} cm`;
    context.fillText(length, left, low - ratio);
  }

  // The bytes of a base64 text.
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

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
    drawRobot, drawOverlay, offerOverlays, clustered, drawWaypoints, drawGrid, setDark, bytes, cells, shades,
    drawPicture,
  };
})();
