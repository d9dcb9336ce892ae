// The plate in square tiles of every level of detail, each level twice as fine as the one before. A frame copies tiles;
// what it lacks it takes from coarser ones, and paints a few tiles, so that no frame is long.

const TILE_PX = 256;
const TILES_KEPT = 500;
const PAINTING_MS = 9;
const FIRST_PAINTING_MS = 150;
const MOST_LEVELS_UP = 8;

/** The coarsest level with at least so many pixels for a nanometre. */
function levelOf(scale) {
  return Math.ceil(Math.log2(scale) - 1e-9);
}

class Tiles {
  /** Tiles of the scale at which the whole is seen, and of coarser ones, stay. */
  constructor(painter, cell, shown, wholeScale) {
    [this.painter, this.cell, this.shown] = [painter, cell, shown];
    this.kept = new Map();
    this.lasting = levelOf(wholeScale);
    this.patience = FIRST_PAINTING_MS;
  }

  /** Draw what a view shows; true if nothing is missing. `view`: x, y of the middle in nm, scale in pixels per nm. */
  draw(context, view, width, height) {
    const level = levelOf(view.scale);
    const side = TILE_PX / 2 ** level;
    const x0 = view.x - width / 2 / view.scale, y0 = -view.y - height / 2 / view.scale;
    const wanted = [];
    for (let j = Math.floor(y0 / side); j * side < y0 + height / view.scale; j++) {
      for (let i = Math.floor(x0 / side); i * side < x0 + width / view.scale; i++) wanted.push([i, j]);
    }
    const missing = wanted.filter(([i, j]) => !this.use(level, i, j));
    const away = ([i, j]) => Math.hypot((i + 0.5) * side - view.x, (j + 0.5) * side + view.y);
    missing.sort((one, other) => away(one) - away(other));
    const deadline = performance.now() + this.patience;
    this.painter.begin(deadline);
    let painted = 0;
    while (painted < missing.length && (painted === 0 || performance.now() < deadline)) {
      if (!this.paint(level, ...missing[painted])) break;
      painted++;
    }
    if (painted === missing.length) this.patience = PAINTING_MS;
    context.setTransform(1, 0, 0, 1, 0, 0);
    for (const [i, j] of wanted) {
      const left = Math.round((i * side - x0) * view.scale), top = Math.round((j * side - y0) * view.scale);
      const right = Math.round(((i + 1) * side - x0) * view.scale);
      const bottom = Math.round(((j + 1) * side - y0) * view.scale);
      this.place(context, level, i, j, [left, top, right - left, bottom - top]);
    }
    return painted === missing.length;
  }

  place(context, level, i, j, [left, top, width, height]) {
    for (let up = 0; up <= MOST_LEVELS_UP; up++) {
      const parts = 2 ** up, tile = this.kept.get(`${level - up},${Math.floor(i / parts)},${Math.floor(j / parts)}`);
      if (!tile) continue;
      const part = TILE_PX / parts;
      const x = (i - Math.floor(i / parts) * parts) * part, y = (j - Math.floor(j / parts) * parts) * part;
      context.drawImage(tile, x, y, part, part, left, top, width, height);
      return;
    }
  }

  /** Whether a tile is there; it will be kept longer. */
  use(level, i, j) {
    const name = `${level},${i},${j}`, tile = this.kept.get(name);
    if (!tile) return false;
    this.kept.delete(name);
    this.kept.set(name, tile);
    return true;
  }

  /** Paint one tile; false if its copies take more time than a frame has, of which those that were made are kept. */
  paint(level, i, j) {
    const scale = 2 ** level, canvas = newCanvas(TILE_PX, TILE_PX), context = canvas.getContext("2d");
    const matrix = [scale, 0, 0, -scale, -i * TILE_PX, -j * TILE_PX];
    try {
      this.painter.paint(context, this.cell, matrix, [TILE_PX, TILE_PX], this.shown);
    } catch (reason) {
      if (reason !== LATE) throw reason;
      return false;
    }
    this.kept.set(`${level},${i},${j}`, canvas.transferToImageBitmap ? canvas.transferToImageBitmap() : canvas);
    for (const [name, old] of this.kept) {
      if (this.kept.size <= TILES_KEPT) break;
      if (Number(name.split(",")[0]) <= this.lasting) continue;
      this.kept.delete(name);
      if (old.close) old.close();
    }
    return true;
  }

  forget() {
    for (const old of this.kept.values()) if (old.close) old.close();
    this.kept.clear();
  }
}
