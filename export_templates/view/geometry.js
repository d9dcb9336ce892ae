// The document's cells as they are drawn: contours in nanometres, boxes, and references from cell to cell.
// A matrix [a, b, c, d, e, f] takes (x, y) to (a x + c y + e, b x + d y + f); a box is [x0, y0, x1, y1].

const POLYGONS_AT_ONCE = 256;
const NOTHING = [Infinity, Infinity, -Infinity, -Infinity];

/** Whole numbers from their text: base64 of seven bits a byte, lowest first, the sign in the lowest bit. */
function unpacked(text) {
  const bytes = atob(text), numbers = [];
  let value = 0, weight = 1;
  for (let place = 0; place < bytes.length; place++) {
    const byte = bytes.charCodeAt(place);
    value += (byte & 127) * weight;
    weight *= 128;
    if (byte < 128) {
      numbers.push(value % 2 ? -(value + 1) / 2 : value / 2);
      value = 0;
      weight = 1;
    }
  }
  return numbers;
}

/** Sums from the first number on, each of every `width` numbers by itself. */
function summed(numbers, width) {
  const sums = Float64Array.from(numbers);
  for (let place = width; place < sums.length; place++) sums[place] += sums[place - width];
  return sums;
}

function joined(one, other) {
  return [Math.min(one[0], other[0]), Math.min(one[1], other[1]), Math.max(one[2], other[2]), Math.max(one[3], other[3])];
}

function isNothing(box) {
  return !(box[0] <= box[2]);
}

function product(m, n) {
  return [
    m[0] * n[0] + m[2] * n[1], m[1] * n[0] + m[3] * n[1],
    m[0] * n[2] + m[2] * n[3], m[1] * n[2] + m[3] * n[3],
    m[0] * n[4] + m[2] * n[5] + m[4], m[1] * n[4] + m[3] * n[5] + m[5],
  ];
}

function inverse(m) {
  const size = m[0] * m[3] - m[1] * m[2];
  const [a, b, c, d] = [m[3] / size, -m[1] / size, -m[2] / size, m[0] / size];
  return [a, b, c, d, -(a * m[4] + c * m[5]), -(b * m[4] + d * m[5])];
}

function mapped(m, x, y) {
  return [m[0] * x + m[2] * y + m[4], m[1] * x + m[3] * y + m[5]];
}

/** The box around a box that was moved and turned. */
function mappedBox(m, box) {
  if (isNothing(box)) return NOTHING;
  const corners = [mapped(m, box[0], box[1]), mapped(m, box[2], box[1]), mapped(m, box[0], box[3]), mapped(m, box[2], box[3])];
  const x = corners.map((each) => each[0]), y = corners.map((each) => each[1]);
  return [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)];
}

function apart(one, other) {
  return one[2] < other[0] || one[0] > other[2] || one[3] < other[1] || one[1] > other[3];
}

/** Polygons of one layer in bundles: `points` x, y from the bundle's own corner, `ends` of contours, `box`. */
function bundles(numbers) {
  const found = [];
  let place = 0, x = 0, y = 0;
  while (place < numbers.length) {
    const points = [], ends = [];
    for (let count = 0; count < POLYGONS_AT_ONCE && place < numbers.length; count++) {
      for (let contours = numbers[place++]; contours > 0; contours--) {
        for (let vertices = numbers[place++]; vertices > 0; vertices--) {
          x += numbers[place++];
          y += numbers[place++];
          points.push(x, y);
        }
        ends.push(points.length);
      }
    }
    found.push(bundle(points, ends));
  }
  return found;
}

/** Paths hold single precision, so that they begin at a corner of their own. */
function bundle(points, ends) {
  let box = NOTHING;
  for (let place = 0; place < points.length; place += 2) {
    box = joined(box, [points[place], points[place + 1], points[place], points[place + 1]]);
  }
  const own = Float64Array.from(points, (value, place) => value - box[place % 2]);
  return { points: own, ends, box, path: null };
}

function pathOf(some) {
  if (some.path) return some.path;
  const path = new Path2D();
  let start = 0;
  for (const end of some.ends) {
    path.moveTo(some.points[start], some.points[start + 1]);
    for (let place = start + 2; place < end; place += 2) path.lineTo(some.points[place], some.points[place + 1]);
    path.closePath();
    start = end;
  }
  return (some.path = path);
}

/** Cells with `boxes` by layer, `box` of all layers, how often each is `placed`, its `references` to others in groups. */
function readCells(told) {
  const cells = [];
  for (const each of told.cells) {
    const cell = { place: cells.length, name: each.name, texts: each.texts, shapes: new Map(), groups: [],
      boxes: new Map(), box: NOTHING, placed: 0, references: 0 };
    for (const [layer, text] of each.shapes) {
      const own = bundles(unpacked(text));
      cell.shapes.set(layer, own);
      for (const some of own) widen(cell, layer, some.box);
    }
    for (const group of each.groups) cell.groups.push(readGroup(group, cells, cell));
    cells.push(cell);
  }
  return cells;
}

function widen(cell, layer, box) {
  cell.boxes.set(layer, joined(cell.boxes.get(layer) || NOTHING, box));
  cell.box = joined(cell.box, box);
}

function readGroup(told, cells, parent) {
  const cell = cells[told.cell], origins = summed(unpacked(told.at), 2);
  const group = { cell, turn: [...told.turn, 0, 0], steps: told.steps, counts: told.counts, origins };
  const copies = origins.length / 2 * told.counts[0] * told.counts[1];
  cell.placed += copies;
  parent.references += copies;
  let spread = NOTHING;
  for (let place = 0; place < origins.length; place += 2) {
    for (const i of [0, told.counts[0] - 1]) {
      for (const j of [0, told.counts[1] - 1]) {
        const x = origins[place] + i * told.steps[0][0] + j * told.steps[1][0];
        const y = origins[place + 1] + i * told.steps[0][1] + j * told.steps[1][1];
        spread = joined(spread, [x, y, x, y]);
      }
    }
  }
  for (const [layer, box] of cell.boxes) {
    const turned = mappedBox(group.turn, box);
    widen(parent, layer, [spread[0] + turned[0], spread[1] + turned[1], spread[2] + turned[2], spread[3] + turned[3]]);
  }
  return group;
}

/** Call `found(x, y)` for the origin of every reference of a group whose cell may reach into a box. */
function eachPlaced(group, box, found) {
  const reach = mappedBox(group.turn, group.cell.box);
  const [x0, y0, x1, y1] = [box[0] - reach[2], box[1] - reach[3], box[2] - reach[0], box[3] - reach[1]];
  const [columns, rows] = group.counts, [along, up] = group.steps;
  const square = along[1] === 0 && up[0] === 0 && along[0] > 0 && up[1] > 0;
  for (let place = 0; place < group.origins.length; place += 2) {
    const x = group.origins[place], y = group.origins[place + 1];
    if (columns === 1 && rows === 1) {
      if (x >= x0 && x <= x1 && y >= y0 && y <= y1) found(x, y);
      continue;
    }
    const first = square ? Math.max(0, Math.ceil((x0 - x) / along[0])) : 0;
    const last = square ? Math.min(columns - 1, Math.floor((x1 - x) / along[0])) : columns - 1;
    const low = square ? Math.max(0, Math.ceil((y0 - y) / up[1])) : 0;
    const high = square ? Math.min(rows - 1, Math.floor((y1 - y) / up[1])) : rows - 1;
    for (let j = low; j <= high; j++) {
      for (let i = first; i <= last; i++) {
        const placedX = x + i * along[0] + j * up[0], placedY = y + i * along[1] + j * up[1];
        if (placedX >= x0 && placedX <= x1 && placedY >= y0 && placedY <= y1) found(placedX, placedY);
      }
    }
  }
}

/** The box that a group's cells take up about their origins: a field of the grid on which they lie, if it holds them. */
function roomOf(group, grid) {
  const box = mappedBox(group.turn, group.cell.box);
  if (!grid) return box;
  const x = Math.floor(box[0] / grid.x) * grid.x, y = Math.floor(box[1] / grid.y) * grid.y;
  const field = [x, y, x + grid.x, y + grid.y];
  return joined(field, box).every((side, at) => side === field[at]) ? field : box;
}

/** Steps of the grid on which all references of a cell lie, and one of its points; null if there is none. */
function gridOf(cell) {
  if (cell.grid !== undefined) return cell.grid;
  const divisor = (a, b) => { while (b) [a, b] = [b, a % b]; return a; };
  let [x, y, origin] = [0, 0, null];
  for (const group of cell.groups) {
    origin = origin || [group.origins[0], group.origins[1]];
    for (let place = 0; place < group.origins.length; place += 2) {
      x = divisor(Math.abs(group.origins[place] - origin[0]), x);
      y = divisor(Math.abs(group.origins[place + 1] - origin[1]), y);
    }
    for (const axis of [0, 1]) {
      if (group.counts[axis] > 1) {
        x = divisor(Math.abs(group.steps[axis][0]), x);
        y = divisor(Math.abs(group.steps[axis][1]), y);
      }
    }
  }
  return (cell.grid = x && y ? { x, y, origin } : null);
}
