// One layer of a cell painted through a matrix from nanometres to pixels. Small cells that stand at many places are
// painted once and copied; a cell of very many small ones is painted once too, some pixels for each.

const MOST_COPIED_PX = 256;
const TINY_PX = 8;
const SMALL_PX = 24;
const SMALL_FINER = 8;
const MANY = 64;
const MOST_PICTURE_PX = 4096;
const COPIES_KEPT_PX = 16e6;
const HATCH_FROM_PX = 40;
const LATE = Symbol("no time for another copy");

// Colours after Okabe and Ito; hatching tells layers apart where colours do not. Those further down are painted later.
const LOOKS = {
  OUTLINE: { fill: "--outline", lined: true },
  NOTE: { fill: "--outline", lined: true },
  BLACK: { fill: "--black", hatch: "dots" },
  GUTTER: { fill: "#c9c9c9", hatch: "dots" },
  CLEAR: { fill: "--clear" },
  CHROME: { fill: "--outline" },
  RED: { fill: "#d55e00", hatch: "rising" },
  GREEN: { fill: "#009e73", hatch: "falling" },
  BLUE: { fill: "#0072b2", hatch: "upright" },
  VEIL: { fill: "#f0e442", hatch: "rising" },
  CIRCUIT: { fill: "#e69f00", hatch: "cross" },
  WIRE1: { fill: "#ffc857", hatch: "level" },
  WIRE2: { fill: "#cc79a7", hatch: "upright" },
};
const OTHERS = [
  { fill: "#ffc857", hatch: "cross" }, { fill: "#cc79a7", hatch: "cross" }, { fill: "#f0e442", hatch: "cross" },
];
const HATCHES = {
  rising: [[0, 8, 8, 0], [-2, 2, 2, -2], [6, 10, 10, 6]],
  falling: [[0, 0, 8, 8], [-2, 6, 2, 10], [6, -2, 10, 2]],
  upright: [[4, 0, 4, 8]],
  level: [[0, 4, 8, 4]],
  cross: [[4, 0, 4, 8], [0, 4, 8, 4]],
  dots: [[3, 4, 5, 4]],
};

function newCanvas(width, height) {
  if (typeof OffscreenCanvas === "function") return new OffscreenCanvas(width, height);
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width, height];
  return canvas;
}

const colours = new Map();

/** Of a name of the style sheet, which is asked once for each scheme; other colours as they are. */
function colour(name) {
  if (!name.startsWith("--")) return name;
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return colours.get(name);
}

function hatching(kind) {
  const canvas = newCanvas(8, 8), context = canvas.getContext("2d");
  context.strokeStyle = colour("--hatch");
  context.lineWidth = kind === "dots" ? 2 : 1;
  context.beginPath();
  for (const [x0, y0, x1, y1] of HATCHES[kind]) {
    context.moveTo(x0, y0);
    context.lineTo(x1, y1);
  }
  context.stroke();
  return context.createPattern(canvas, "repeat");
}

/** Order, colour and hatching of the document's layers, lowest first. */
function looksOf(layers) {
  const names = Object.keys(LOOKS);
  let others = 0;
  const found = layers.map((layer, place) => {
    const look = LOOKS[layer.name] || OTHERS[others++ % OTHERS.length];
    const rank = names.indexOf(layer.name);
    return { place, rank: rank < 0 ? names.length : rank, fill: colour(look.fill), lined: Boolean(look.lined),
      hatch: look.hatch ? hatching(look.hatch) : null };
  });
  return found.sort((one, other) => one.rank - other.rank || one.place - other.place);
}

class Painter {
  constructor(looks) {
    this.looks = looks;
    this.copies = new Map();
    this.keptPx = 0;
    this.begin(Infinity);
  }

  /** After the deadline no second copy is made; one always is, lest the same be begun for ever. */
  begin(deadline) {
    this.deadline = deadline;
    this.made = 0;
  }

  /** Paint those layers of a cell; a canvas of that size is seen. */
  paint(context, cell, matrix, size, shown) {
    for (const look of this.looks) {
      if (shown.has(look.place)) this.cell(context, cell, look, matrix, size);
    }
  }

  cell(context, cell, look, matrix, size) {
    const box = cell.boxes.get(look.place);
    if (!box || apart(mappedBox(matrix, box), [0, 0, size[0], size[1]])) return;
    const picture = this.picture(cell, look, matrix);
    if (picture) {
      context.setTransform(...product(matrix, picture.placed));
      context.imageSmoothingQuality = "medium";
      context.drawImage(picture.canvas, 0, 0);
      return;
    }
    this.inside(context, cell, look, matrix, size);
  }

  inside(context, cell, look, matrix, size) {
    for (const some of cell.shapes.get(look.place) || []) this.fill(context, some, look, matrix, size);
    const seen = mappedBox(inverse(matrix), [0, 0, size[0], size[1]]);
    for (const group of cell.groups) {
      if (!group.cell.boxes.has(look.place)) continue;
      const turned = product(matrix, group.turn);
      const square = (turned[1] === 0 && turned[2] === 0) || (turned[0] === 0 && turned[3] === 0);
      const room = roomOf(group, gridOf(cell));
      eachPlaced(group, seen, (x, y) => {
        const [e, f] = mapped(matrix, x, y);
        const placed = [turned[0], turned[1], turned[2], turned[3], e, f];
        const box = mappedBox(matrix, [room[0] + x, room[1] + y, room[2] + x, room[3] + y]);
        if (square && group.cell.placed > 1) this.snapped(context, group.cell, look, placed, size, box);
        else this.cell(context, group.cell, look, placed, size);
      });
    }
  }

  /** The room of a cell takes whole pixels, lest a line of half-covered ones be seen between neighbours. */
  snapped(context, cell, look, matrix, size, box) {
    const x = Math.round(box[0]), y = Math.round(box[1]);
    const width = Math.max(1, Math.round(box[2]) - x), height = Math.max(1, Math.round(box[3]) - y);
    const across = width / (box[2] - box[0] || 1), down = height / (box[3] - box[1] || 1);
    const [a, b, c, d] = [matrix[0] * across, matrix[1] * down, matrix[2] * across, matrix[3] * down];
    const own = [a, b, c, d, (matrix[4] - box[0]) * across, (matrix[5] - box[1]) * down];
    if (width > MOST_COPIED_PX || height > MOST_COPIED_PX) {
      this.cell(context, cell, look, [a, b, c, d, own[4] + x, own[5] + y], size);
      return;
    }
    const turn = [a, b, c, d].map(Math.sign).join("");
    const copy = this.kept(`${cell.place},${look.place},${width},${height},${turn}`, width, height, (canvas) => {
      const finer = Math.max(width, height) < SMALL_PX ? SMALL_FINER : 1;
      if (finer === 1) this.cell(canvas, cell, look, own, [width, height]);
      else this.averaged(canvas, cell, look, own.map((each) => each * finer), [width, height], finer);
    });
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(copy, x, y);
  }

  /** Browsers count what a pixel is covered by coarsely, so that details smaller than that are painted large first. */
  averaged(context, cell, look, matrix, [width, height], finer) {
    let painted = newCanvas(width * finer, height * finer);
    this.cell(painted.getContext("2d"), cell, look, matrix, [painted.width, painted.height]);
    while (painted.width > width) {
      // Halved step by step, which every browser's smoothing does exactly.
      const half = newCanvas(painted.width / 2, painted.height / 2);
      half.getContext("2d").drawImage(painted, 0, 0, half.width, half.height);
      painted = half;
    }
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(painted, 0, 0);
  }

  /** A cell of many small ones by itself, whole pixels for each; null where they are few, or large. */
  picture(cell, look, matrix) {
    const grid = gridOf(cell);
    if (!grid) return null;
    const scale = Math.hypot(matrix[0], matrix[1]);
    const columns = (cell.box[2] - cell.box[0]) / grid.x, rows = (cell.box[3] - cell.box[1]) / grid.y;
    const pixels = scale * Math.max(grid.x, grid.y);
    if (pixels > TINY_PX || cell.references < Math.max(MANY, columns * rows / 4)) return null;
    let finest = TINY_PX;
    while (finest > 1 && Math.max(columns, rows) * finest > MOST_PICTURE_PX) finest /= 2;
    if (Math.max(columns, rows) * finest > MOST_PICTURE_PX) return null;
    const each = Math.min(finest, Math.max(1, 2 ** Math.ceil(Math.log2(pixels))));
    const left = Math.floor((cell.box[0] - grid.origin[0]) / grid.x) * grid.x + grid.origin[0];
    const top = Math.ceil((cell.box[3] - grid.origin[1]) / grid.y) * grid.y + grid.origin[1];
    const inward = (size) => [size / grid.x, 0, 0, -size / grid.y, (-left * size) / grid.x, (top * size) / grid.y];
    const fields = [Math.ceil((cell.box[2] - left) / grid.x), Math.ceil((top - cell.box[1]) / grid.y)];
    return { canvas: this.pictureOf(cell, look, inward, fields, each, finest), placed: inverse(inward(each)) };
  }

  /** The finest is painted; each coarser one is that before it, halved. */
  pictureOf(cell, look, inward, fields, each, finest) {
    const [width, height] = fields.map((count) => count * each);
    return this.kept(`${cell.place},${look.place},${each}`, width, height, (context) => {
      if (each === finest) this.inside(context, cell, look, inward(each), [width, height]);
      else context.drawImage(this.pictureOf(cell, look, inward, fields, 2 * each, finest), 0, 0, width, height);
    });
  }

  fill(context, some, look, matrix, size) {
    const box = mappedBox(matrix, some.box);
    if (apart(box, [0, 0, size[0], size[1]])) return;
    const placed = product(matrix, [1, 0, 0, 1, some.box[0], some.box[1]]);
    context.setTransform(...placed);
    context.fillStyle = look.fill;
    const path = pathOf(some);
    context.fill(path);
    if (look.lined) {
      context.strokeStyle = look.fill;
      context.lineWidth = 1 / Math.hypot(placed[0], placed[1]);
      context.stroke(path);
    }
    if (look.hatch && Math.max(box[2] - box[0], box[3] - box[1]) > HATCH_FROM_PX) {
      look.hatch.setTransform(new DOMMatrix(inverse(placed)));
      context.fillStyle = look.hatch;
      context.fill(path);
    }
  }

  /** A canvas under a name, painted once; those used longest ago make room. Throws LATE after the deadline. */
  kept(name, width, height, paint) {
    const found = this.copies.get(name);
    if (found) {
      this.copies.delete(name);
      this.copies.set(name, found);
      return found;
    }
    if (this.made > 0 && performance.now() > this.deadline) throw LATE;
    const canvas = newCanvas(width, height);
    paint(canvas.getContext("2d"));
    this.made++;
    const copy = canvas.transferToImageBitmap ? canvas.transferToImageBitmap() : canvas;
    this.copies.set(name, copy);
    this.keptPx += width * height;
    for (const [other, old] of this.copies) {
      if (this.keptPx <= COPIES_KEPT_PX || other === name) break;
      this.keptPx -= old.width * old.height;
      if (old.close) old.close();
      this.copies.delete(other);
    }
    return copy;
  }
}
