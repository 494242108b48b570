// ---- faults by click: place on the robot's wiring, kind, and the settings of a scenario

// Place of the next fault: {link, direction} or {device}.
let target = null;

function beginFaults(stage) {
  target = null;
  if (!stage.faults) return;
  const pick = (text, label, place) => {
    const node = button(text, label, () => choose(place, node));
    node.setAttribute("role", "radio");
    node.setAttribute("aria-checked", "false");
    node.dataset.place = JSON.stringify(place);
    return node;
  };
  const way = (link, direction) => {
    return pick(direction, `${link.name} ${direction}`, { link: link.name, direction });
  };
  const lines = stage.links.map((link) => {
    const line = make("div", "", { className: "link" }), wire = make("span");
    wire.append(make("b", link.name));
    line.append("program", way(link, "to-master"), wire, way(link, "to-device"), "device");
    return line;
  });
  const devices = make("div", "", { className: "bar" });
  devices.append("the device itself:", ...stage.devices.map(({ name }) =>
    pick(name, `device ${name}`, { device: name })));
  $("wiring").replaceChildren(...lines, ...(stage.devices.length ? [devices] : []));
  $("wiring").querySelector("button")?.click();
}

function choose(place, node) {
  target = place;
  for (const other of $("wiring").querySelectorAll("button")) {
    other.setAttribute("aria-checked", String(other === node));
  }
  const link = hilrig.stage.links.find((one) => one.name === place.link);
  const fits = ({ place: keys, links }) => link
    ? keys.includes("link") && links.includes(link.kind) : !keys.includes("link");
  const before = $("fault-kind").value, kinds = hilrig.stage.faults.kinds.filter(fits);
  // Faults of single bytes, of a whole line, and of a device.
  const groups = [
    ["single bytes", (kind) => kind.keys.includes("byte")],
    ["the line", (kind) => !kind.keys.includes("byte") && kind.place.includes("link")],
    ["the device", (kind) => !kind.place.includes("link")],
  ];
  $("fault-kind").replaceChildren(...groups.flatMap(([label, holds]) => {
    const group = make("optgroup", "", { label });
    group.append(...kinds.filter(holds).map(({ name }) => make("option", name, { value: name })));
    return group.childElementCount ? [group] : [];
  }));
  if (kinds.some((kind) => kind.name === before)) $("fault-kind").value = before;
  showKind();
}

const kindNow = () =>
  hilrig.stage.faults.kinds.find((kind) => kind.name === $("fault-kind").value);

// An input for a key: choices, a number between bounds, or a text.
function keyField(key, first, schema = hilrig.stage.faults.keys[key] ?? {}) {
  const label = make("label", key), types = [schema.type].flat();
  const devices = hilrig.stage.devices.map((device) => device.name);
  const own = hilrig.stage.devices.find((device) => device.name === target.device)?.faults;
  const choices = {
    with: hilrig.stage.links.map((link) => link.name), fault: own, device: devices,
  }[key];
  const field = make(choices?.length ? "select" : "input", "", { name: key });
  if (choices?.length) {
    field.append(...choices.map((choice) => make("option", choice, { value: choice })));
  } else if (types.includes("number") || types.includes("integer")) {
    Object.assign(field, { type: "number", step: types.includes("integer") ? "1" : "any" });
    if (schema.minimum !== undefined) field.min = schema.minimum;
    if (schema.maximum !== undefined) field.max = schema.maximum;
    field.dataset.number = "true";
  } else if (types.includes("array")) {
    const isPlace = schema.maxItems === 2;
    field.placeholder = isPlace ? "1.5, 0.8" : devices.join(", ");
    field.dataset.list = isPlace ? "numbers" : "names";
  } else {
    field.placeholder = "20ms";
  }
  if (key === "rate") field.value = "0.01";
  if (first && key === "devices") field.value = devices.join(", ");
  label.append(field, make("small", (schema.description ?? "").replaceAll("`", "")));
  return label;
}

// The value in the input of a key.
function fieldValue(field) {
  const parts = () => field.value.split(",").map((part) => part.trim());
  if (field.dataset.list === "names") return parts();
  if (field.dataset.list === "numbers") return parts().map(Number);
  return field.dataset.number ? Number(field.value) : field.value;
}

// A condition that begins the fault: a choice of its kind, then the keys of that kind.
function whenFields() {
  const { when, keys } = hilrig.stage.faults, box = make("div", "", { id: "fault-condition" });
  const choice = make("select", "", { id: "fault-waits" }), label = make("label", "waits until");
  choice.append(make("option", "nothing: at once", { value: "" }),
    ...when.map(({ about }, index) => make("option", about, { value: index })));
  choice.onchange = () => box.replaceChildren(...(when[choice.value]?.keys ?? []).map((key) => {
    const field = keyField(key, false, keys.when.properties[key]);
    field.querySelector("[name]").required = true;
    return field;
  }));
  label.append(choice);
  return [label, box];
}

function showKind() {
  const kind = kindNow();
  if (!kind) return;
  say("fault-about", kind.about);
  const keys = [...(kind.place.includes("devices") ? ["devices"] : []), ...kind.keys];
  $("fault-keys").replaceChildren(...keys.map((key) => keyField(key, true)));
  // A condition is a table of its own, and the duration is given in seconds below.
  const times = hilrig.stage.faults.time.filter((key) => key !== "when" && key !== "until");
  $("fault-when").replaceChildren(...whenFields(), ...times.map((key) => keyField(key, false)));
}

$("fault-kind").onchange = showKind;
$("fault").onsubmit = (event) => {
  event.preventDefault();
  const kind = kindNow(), held = Number($("fault-s").value), fault = { kind: kind.name };
  for (const key of kind.place) if (target[key] !== undefined) fault[key] = target[key];
  for (const field of $("fault").querySelectorAll("[name]")) {
    if (field.value === "") continue;
    const inside = $("fault-condition").contains(field) ? fault.when ??= {} : fault;
    inside[field.name] = fieldValue(field);
  }
  // A byte with a number is hit once, so a rate would contradict the number.
  if (fault.byte !== undefined) delete fault.rate;
  // A fault with a condition begins at an unknown time, so it needs a duration.
  const waits = ["when", "at_byte", "at_frame"].some((key) => fault[key] !== undefined);
  if (waits && held > 0) fault.lasting ??= `${Math.round(held * 1000)}ms`;
  send({ do: "fault", fault, for_ms: held > 0 && !waits ? Math.round(held * 1000) : null });
};

// ---- the list of faults

function showFaults(faults) {
  const now = seen().now.at_ns / 1e9;
  const last = faults.slice(-30).reverse();
  once("faults", [last, Boolean(hilrig.past)], () => last.map(faultItem));
  for (const bar of document.querySelectorAll("#faults progress")) {
    const [from, to] = [Number(bar.dataset.from), Number(bar.dataset.to)];
    bar.value = Math.min(Math.max((now - from) / Math.max(to - from, 1e-9), 0), 1);
  }
}

// A condition as keys and values.
const inWords = (value) => typeof value !== "object" || Array.isArray(value) ? String(value)
  : Object.entries(value).map(([key, inner]) => `${key} ${inner}`).join(" ");

const HIDDEN = ["kind", "link", "direction", "device", "devices", "from", "until"];
function faultItem({ id, state, fault }) {
  const item = make("li"), [from, to] = [seconds(fault.from), seconds(fault.until)];
  const settings = Object.entries(fault).filter(([key]) => !HIDDEN.includes(key))
    .map(([key, value]) => `${key} ${inWords(value)}`);
  const way = fault.direction ? ` ${fault.direction}` : "";
  const times = [["from", from], ["to", to]].map(([word, at]) =>
    at === null ? "" : ` ${word} ${clockText(at)}`);
  item.append(make("strong", fault.kind), ` ${placeOf(fault)}${way} ${settings.join(", ")}`,
    `${times.join("")}: ${state} `);
  if (state !== "over") {
    const end = button("End", `end fault ${id}`, (event) => {
      event.target.blur();
      send({ do: "end-fault", id });
    });
    end.disabled = Boolean(hilrig.past);
    item.append(end);
    if (to !== null) {
      const bar = make("progress", "", { max: 1, value: 0 });
      bar.setAttribute("aria-label", `time of fault ${id}`);
      Object.assign(bar.dataset, { from: from ?? 0, to });
      item.append(bar);
    }
  }
  return item;
}
