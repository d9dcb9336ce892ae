// The view: what is seen of the plate, how it is moved, and what is drawn on top.

const REACH_PX = 12;
const STILL_PX = 4;
const FINEST_PX_PER_NM = 0.2;
const CLUSTER_PX = 44;
const NAMED_FROM_PX = 50;

const told = JSON.parse(byId("document").textContent);
const cells = readCells(told);
const top_ = cells[told.top];
const plateBox = isNothing(top_.box) ? told.box : top_.box;
const rules = told.rules.map((rule) => ({ ...rule, places: summed(unpacked(rule.places), 4), shown: true }));
const shown = new Set(told.layers.flatMap((layer, place) => (layer.written || layer.name === "OUTLINE" ? [place] : [])));
if (!shown.size) told.layers.forEach((_, place) => shown.add(place));

const canvas = byId("plate"), context = canvas.getContext("2d", { alpha: false });
const view = { x: 0, y: 0, scale: 1 };  // of the middle in nm; CSS pixels per nm
let looks, tiles, size = [0, 0], ratio = 1, asked = false, framed = false, whole = false;
let chosen = null, hovered = null, ruler = null, placeAt = null;
let pointed = null;  // box in nm of the place that was gone to

// --- What is seen ---------------------------------------------------------------------------------------------------

function redraw() {
  if (asked || !tiles) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    drawFrame();
  });
}

function restyle() {
  colours.clear();
  looks = looksOf(told.layers);
  listLayers(told.layers, looks, shown, retile);
  retile();
}

function retile() {
  if (tiles) tiles.forget();
  tiles = new Tiles(new Painter(looks), top_, shown, wholeScale() * ratio);
  redraw();
}

function resize() {
  const area = canvas.getBoundingClientRect();
  ratio = Math.min(2, window.devicePixelRatio || 1);
  size = [area.width, area.height];
  canvas.width = Math.max(1, Math.round(area.width * ratio));
  canvas.height = Math.max(1, Math.round(area.height * ratio));
  if (!framed && area.width > 0) {
    framed = true;
    showWhole();
    follow();
  } else if (whole) showWhole();  // as when a telephone is turned
  redraw();
}

function wholeScale() {
  const [wide, high] = [plateBox[2] - plateBox[0] || 1, plateBox[3] - plateBox[1] || 1];
  return Math.max(1, Math.min(size[0], size[1])) / Math.max(wide, high);
}

function showWhole() {
  frame(plateBox, 0.94);
  whole = true;
}

function frame(box, share) {
  whole = false;
  const wide = Math.max(box[2] - box[0], 1000), high = Math.max(box[3] - box[1], 1000);
  view.x = (box[0] + box[2]) / 2;
  view.y = (box[1] + box[3]) / 2;
  view.scale = Math.min(FINEST_PX_PER_NM, share * Math.min(size[0] / wide, size[1] / high));
  redraw();
}

function toPlate(x, y) {
  return [view.x + (x - size[0] / 2) / view.scale, view.y - (y - size[1] / 2) / view.scale];
}

function toScreen(x, y) {
  return [size[0] / 2 + (x - view.x) * view.scale, size[1] / 2 - (y - view.y) * view.scale];
}

function zoom(factor, x = size[0] / 2, y = size[1] / 2) {
  whole = false;
  const [px, py] = toPlate(x, y);
  view.scale = Math.min(FINEST_PX_PER_NM, Math.max(wholeScale() / 3, view.scale * factor));
  view.x = px - (x - size[0] / 2) / view.scale;
  view.y = py + (y - size[1] / 2) / view.scale;
  redraw();
}

function pan(x, y) {
  whole = false;
  view.x = Math.min(plateBox[2], Math.max(plateBox[0], view.x - x / view.scale));
  view.y = Math.min(plateBox[3], Math.max(plateBox[1], view.y + y / view.scale));
  redraw();
}

// --- Drawing --------------------------------------------------------------------------------------------------------

function drawFrame() {
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.fillStyle = colour("--chrome");
  context.fillRect(0, 0, canvas.width, canvas.height);
  const seen = { x: view.x, y: view.y, scale: view.scale * ratio };
  const done = tiles.draw(context, seen, canvas.width, canvas.height);
  if (canvas.getAttribute("aria-busy") !== String(!done)) canvas.setAttribute("aria-busy", String(!done));
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  drawTexts();
  drawDies();
  drawRules();
  drawPointed();
  drawRuler();
  drawScaleBar();
  if (!done) redraw();
}

/** Words that stay legible on anything. */
function label(words, x, y, ink = colour("--ink")) {
  context.font = "12px system-ui, sans-serif";
  context.lineWidth = 4;
  context.lineJoin = "round";
  context.strokeStyle = colour("--page");
  context.strokeText(words, x, y);
  context.fillStyle = ink;
  context.fillText(words, x, y);
}

function drawTexts() {
  for (const [layer, x, y, words] of top_.texts) {
    if (shown.has(layer)) label(words.slice(0, 200), ...toScreen(x, y));
  }
}

function drawDies() {
  told.dies.forEach((die, place) => {
    const [x0, y1] = toScreen(die.box[0], die.box[1]), [x1, y0] = toScreen(die.box[2], die.box[3]);
    if (x1 < 0 || y1 < 0 || x0 > size[0] || y0 > size[1]) return;
    context.lineWidth = place === chosen ? 3 : 1;
    context.strokeStyle = colour(place === chosen || place === hovered ? "--accent" : "--outline");
    context.setLineDash(place === chosen ? [] : [4, 3]);
    context.strokeRect(x0 - 2, y0 - 2, x1 - x0 + 4, y1 - y0 + 4);
    context.setLineDash([]);
    if (y0 > 20 && (x1 - x0 > NAMED_FROM_PX || place === chosen || place === hovered)) {
      label(`${die.best ? "★ " : ""}${die.name.slice(0, 40)}`, Math.max(x0, 4), y0 - 6);
    }
  });
}

/** Places of broken rules; of many close by one mark with their number. */
function drawRules() {
  const clusters = new Map();
  rules.forEach((rule) => {
    if (!rule.shown) return;
    for (let at = 0; at < rule.places.length; at += 4) {
      const [x0, y1] = toScreen(rule.places[at], rule.places[at + 1]);
      const [x1, y0] = toScreen(rule.places[at + 2], rule.places[at + 3]);
      if (x1 < -20 || y1 < -20 || x0 > size[0] + 20 || y0 > size[1] + 20) continue;
      const key = `${Math.floor((x0 + x1) / 2 / CLUSTER_PX)},${Math.floor((y0 + y1) / 2 / CLUSTER_PX)}`;
      const cluster = clusters.get(key);
      if (cluster) {
        cluster.count++;
        cluster.sums = cluster.sums.map((sum, side) => sum + [x0, y0, x1, y1][side]);
      } else clusters.set(key, { count: 1, sums: [x0, y0, x1, y1] });
    }
  });
  const means = [];
  for (const { count, sums } of clusters.values()) {
    const box = sums.map((sum) => sum / count);
    const near = means.find((each) => Math.hypot(each.box[0] - box[0], each.box[1] - box[1]) < CLUSTER_PX * 0.8);
    if (near) near.count += count;
    else means.push({ count, box });
  }
  for (const { box } of means) mark(box);
  for (const { box, count } of means) {
    if (count > 1) label(String(count), (box[0] + box[2]) / 2 - 4 * String(count).length, (box[1] + box[3]) / 2 + 19);
  }
}

function mark([x0, y0, x1, y1]) {
  const x = (x0 + x1) / 2, y = (y0 + y1) / 2;
  for (const [width, ink] of [[5, "--page"], [2, "--mark"]]) {
    context.lineWidth = width;
    context.strokeStyle = colour(ink);
    context.beginPath();
    if (x1 - x0 > 12 || y1 - y0 > 12) context.rect(x0, y0, x1 - x0, y1 - y0);
    else {
      context.moveTo(x, y - 7);
      context.lineTo(x + 7, y + 5);
      context.lineTo(x - 7, y + 5);
      context.closePath();
    }
    context.stroke();
  }
}

/** The place that was gone to: a ring about it with four strokes that lead there, whatever else is marked. */
function drawPointed() {
  if (!pointed) return;
  const [x0, y1] = toScreen(pointed[0], pointed[1]), [x1, y0] = toScreen(pointed[2], pointed[3]);
  const x = (x0 + x1) / 2, y = (y0 + y1) / 2, radius = Math.hypot(x1 - x0, y1 - y0) / 2 + 14;
  for (const [width, ink] of [[7, "--page"], [3, "--rule"]]) {
    context.lineWidth = width;
    context.strokeStyle = colour(ink);
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    for (const [across, down] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + across * radius, y + down * radius);
      context.lineTo(x + across * (radius + 12), y + down * (radius + 12));
    }
    context.stroke();
  }
}

function drawRuler() {
  if (!ruler) return;
  const points = ruler.points.concat(ruler.points.length === 1 && ruler.next ? [ruler.next] : []);
  const places = points.map((point) => toScreen(point.x, point.y));
  if (places.length === 2) {
    for (const [width, ink] of [[5, "--page"], [2, "--rule"]]) {
      context.lineWidth = width;
      context.strokeStyle = colour(ink);
      context.beginPath();
      context.moveTo(...places[0]);
      context.lineTo(...places[1]);
      context.stroke();
    }
    const middle = [(places[0][0] + places[1][0]) / 2 + 8, (places[0][1] + places[1][1]) / 2 - 8];
    label(micrometres(Math.hypot(points[1].x - points[0].x, points[1].y - points[0].y)), ...middle);
  }
  const ends = ruler.points.length < 2 && ruler.next ? ruler.points.concat([ruler.next]) : ruler.points;
  for (const end of ends) crosshair(...toScreen(end.x, end.y), end.on);
  if (ruler.byKeys) crosshair(size[0] / 2, size[1] / 2, null);
}

/** A square on a corner, a circle on an edge, a cross anywhere else. */
function crosshair(x, y, on) {
  for (const [width, ink] of [[4, "--page"], [1.5, "--rule"]]) {
    context.lineWidth = width;
    context.strokeStyle = colour(ink);
    context.beginPath();
    if (on === "corner") context.rect(x - 5, y - 5, 10, 10);
    else if (on === "edge") context.arc(x, y, 5, 0, 2 * Math.PI);
    else {
      context.moveTo(x - 8, y);
      context.lineTo(x + 8, y);
      context.moveTo(x, y - 8);
      context.lineTo(x, y + 8);
    }
    context.stroke();
  }
}

function drawScaleBar() {
  const longest = 140 / view.scale, power = 10 ** Math.floor(Math.log10(longest));
  const length = [5, 2, 1].map((step) => step * power).find((step) => step <= longest);
  const [x, y] = [14, size[1] - 16];
  for (const [width, ink] of [[6, "--page"], [3, "--ink"]]) {
    context.lineWidth = width;
    context.strokeStyle = colour(ink);
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + length * view.scale, y);
    context.stroke();
  }
  label(length >= 1e6 ? `${length / 1e6} mm` : length >= 1e3 ? `${length / 1e3} µm` : `${length} nm`, x, y - 8);
}

// --- Dies, rules and ruler ------------------------------------------------------------------------------------------

function dieAt([x, y]) {
  const at = told.dies.findIndex(({ box }) => x >= box[0] && x <= box[2] && y >= box[1] && y <= box[3]);
  return at < 0 ? null : at;
}

function choose(place, framing) {
  if (place !== chosen) {
    pointed = null;
    byId("told").textContent = "";
  }
  chosen = place;
  tellDie(told, place);
  remember(place === null ? {} : { die: told.dies[place].name });
  if (place !== null && framing) frame(told.dies[place].box, 0.85);
  redraw();
}

function hover(place, x, y) {
  const box = byId("hover");
  if (place !== hovered) redraw();
  hovered = place;
  box.hidden = place === null || ruler !== null;
  if (box.hidden) return;
  const die = told.dies[place];
  box.replaceChildren(element("strong", die.name.slice(0, 80)), ...die.rows.slice(0, 4).map((row) => element("div", row.join(": "))));
  box.style.left = `${Math.max(4, Math.min(x + 16, size[0] - box.offsetWidth - 4))}px`;
  box.style.top = `${y + 18 + box.offsetHeight > size[1] ? Math.max(4, y - box.offsetHeight - 12) : y + 18}px`;
}

/** Places of the rules that are shown, rule by rule: box and die of each, and its number on that die. */
function everyPlace() {
  return rules.filter((rule) => rule.shown).flatMap((rule) => {
    const counts = new Map();
    return Array.from({ length: rule.places.length / 4 }, (_, at) => {
      const box = rule.places.slice(4 * at, 4 * at + 4), die = dieAt(middleOf(box));
      counts.set(die, (counts.get(die) || 0) + 1);
      return { rule, box, die, number: counts.get(die) };
    });
  });
}

function middleOf(box) {
  return [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
}

function stepPlace(by) {
  const all = everyPlace();
  if (!all.length) return;
  placeAt = placeAt === null ? (by > 0 ? 0 : all.length - 1) : (placeAt + by + all.length) % all.length;
  goTo(all, placeAt);
}

function goTo(all, at) {
  const { rule, box, die, number } = all[at];
  placeAt = at;
  point(box, `${rule.name}, place ${at + 1} of ${all.length}`);
  remember({ rule: rule.name, ...(die === null ? {} : { die: told.dies[die].name }), place: number });
}

/** Show a place so near that what is wrong there can be seen, ring it, and choose its die. */
function point(box, words) {
  const [x0, y0, x1, y1] = box, around = Math.max(x1 - x0, y1 - y0, 20000) * 2;
  frame([x0 - around, y0 - around, x1 + around, y1 + around], 1);
  const die = dieAt(middleOf(box));
  if (die !== chosen) choose(die, false);
  pointed = box;
  byId("told").textContent = words;
}

/** Put what is seen into the address, to be kept or sent. */
function remember(asked) {
  try {
    history.replaceState(null, "", `#${new URLSearchParams(asked)}`);
  } catch {
    // A page within another may have no address of its own.
  }
}

/** Go where the address says: a rule, the die that breaks it and which of its places there; x and y in µm; or a die. */
function follow() {
  const asked = new URLSearchParams(location.hash.slice(1));
  const named = told.dies.findIndex((die) => die.name === asked.get("die")), die = named < 0 ? null : named;
  const rule = rules.find((each) => each.name === asked.get("rule"));
  const [x, y] = ["x", "y"].map((side) => Number.parseFloat(asked.get(side)) * 1000);
  const what = asked.get("rule") || "";
  if (Number.isFinite(x) && Number.isFinite(y)) {
    point([x, y, x, y], `${what && `${what}, `}x ${micrometres(x)}, y ${micrometres(y)}`);
    return;
  }
  if (rule && !rule.shown) {
    rule.shown = true;
    listRules(told, rules, stepPlace, redraw);
  }
  const all = rule ? everyPlace() : [];
  const own = all.flatMap((place, at) => (place.rule === rule && place.die === die ? [at] : []));
  const at = own[Math.min(own.length, Number.parseInt(asked.get("place"), 10) || 1) - 1];
  if (at !== undefined) goTo(all, at);
  else if (die !== null) {
    choose(die, true);
    if (what) byId("told").textContent = `${what}: no place on ${told.dies[die].name} is told`;
  } else if (what) byId("told").textContent = `${what}: no place is told`;
}

function useRuler(on) {
  ruler = on ? { points: [], next: null, byKeys: false } : null;
  byId("ruler").setAttribute("aria-pressed", String(on));
  canvas.classList.toggle("measuring", on);
  byId("told").textContent = on ? "Ruler: set two points" : "";
  hover(null);
  redraw();
}

function rulerPoint(x, y, anywhere) {
  const [px, py] = toPlate(x, y);
  const found = anywhere ? null : snapped(top_, shown, [px, py], REACH_PX / view.scale, view.scale);
  return found || { x: px, y: py, on: null };
}

function setPoint(point) {
  if (ruler.points.length === 2) ruler.points = [];
  ruler.points.push(point);
  ruler.next = null;
  byId("told").textContent = ruler.points.length === 2 ? distanceText(...ruler.points) : "Ruler: set the second point";
  redraw();
}

// --- Hands ----------------------------------------------------------------------------------------------------------

const touching = new Map();
let moved = 0;

function placeOf(event) {
  const area = canvas.getBoundingClientRect();
  return [event.clientX - area.left, event.clientY - area.top];
}

canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  if (!touching.size) moved = 0;
  touching.set(event.pointerId, placeOf(event));
});

canvas.addEventListener("pointermove", (event) => {
  const [x, y] = placeOf(event), before = touching.get(event.pointerId);
  if (before && touching.size === 1) {
    moved += Math.abs(x - before[0]) + Math.abs(y - before[1]);
    if (moved > STILL_PX) {
      pan(x - before[0], y - before[1]);
      canvas.classList.add("dragged");
    }
  } else if (before && touching.size === 2) {
    const other = [...touching].find(([id]) => id !== event.pointerId)[1];
    const apartBefore = Math.hypot(before[0] - other[0], before[1] - other[1]);
    moved = Infinity;
    pan((x - before[0]) / 2, (y - before[1]) / 2);
    zoom(Math.hypot(x - other[0], y - other[1]) / Math.max(apartBefore, 1), (x + other[0]) / 2, (y + other[1]) / 2);
  }
  if (before) touching.set(event.pointerId, [x, y]);
  const [px, py] = toPlate(x, y);
  byId("where").textContent = `x ${micrometres(Math.round(px))}, y ${micrometres(Math.round(py))}`;
  if (ruler) {
    ruler.byKeys = false;
    ruler.next = ruler.points.length < 2 ? rulerPoint(x, y, event.shiftKey) : null;
    redraw();
  } else if (event.pointerType === "mouse") hover(touching.size ? null : dieAt([px, py]), x, y);
});

function lifted(event) {
  const held = touching.delete(event.pointerId);
  canvas.classList.remove("dragged");
  if (!held || touching.size || moved > STILL_PX || event.type === "pointercancel") return;
  const [x, y] = placeOf(event);
  if (ruler) setPoint(rulerPoint(x, y, event.shiftKey));
  else choose(dieAt(toPlate(x, y)), false);
}

canvas.addEventListener("pointerup", lifted);
canvas.addEventListener("pointercancel", lifted);
canvas.addEventListener("pointerleave", () => hover(null));
canvas.addEventListener("dblclick", (event) => {
  if (!ruler) zoom(event.shiftKey ? 0.5 : 2, ...placeOf(event));
});
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
  zoom(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0016)), ...placeOf(event));
}, { passive: false });

const KEYS = {
  "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: showWhole,
  ArrowLeft: () => pan(60, 0), ArrowRight: () => pan(-60, 0), ArrowUp: () => pan(0, 60), ArrowDown: () => pan(0, -60),
  m: () => useRuler(!ruler), Escape: () => useRuler(false), n: () => stepPlace(1), p: () => stepPlace(-1),
  "[": () => stepDie(-1), "]": () => stepDie(1),
};

function stepDie(by) {
  const count = told.dies.length;
  if (count) choose(chosen === null ? (by > 0 ? 0 : count - 1) : (chosen + by + count) % count, true);
}

canvas.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (key === "Enter" && ruler) setPoint(rulerPoint(size[0] / 2, size[1] / 2, event.shiftKey));
  else if (KEYS[key]) KEYS[key]();
  else return;
  if (ruler) ruler.byKeys = true;
  event.preventDefault();
});

byId("in").addEventListener("click", () => zoom(1.5));
byId("out").addEventListener("click", () => zoom(1 / 1.5));
byId("whole").addEventListener("click", showWhole);
byId("ruler").addEventListener("click", () => useRuler(!ruler));
for (const [name, wanted] of [["mask-only", (layer) => layer.written || layer.name === "OUTLINE"], ["all-layers", () => true]]) {
  byId(name).addEventListener("click", () => {
    shown.clear();
    told.layers.forEach((layer, place) => { if (wanted(layer)) shown.add(place); });
    restyle();
  });
}

listDies(told.dies, (place) => choose(place, true));
listRules(told, rules, stepPlace, redraw);
tellFile(told);
resize();
restyle();
addEventListener("hashchange", follow);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", restyle);
new ResizeObserver(resize).observe(canvas);
