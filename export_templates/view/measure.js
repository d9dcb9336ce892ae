// Points on corners and edges, and the distance between two of them.

const SMALLEST_SEEN_PX = 3;

/** The corner, else the edge's point, of the shown layers that is nearest to a point; null if none is within reach. */
function snapped(cell, shown, point, reach, scale) {
  const best = { corner: reach, edge: reach, cornerAt: null, edgeAt: null };
  const near = [point[0] - reach, point[1] - reach, point[0] + reach, point[1] + reach];
  nearest(cell, [1, 0, 0, 1, 0, 0], shown, point, near, scale, best);
  return best.cornerAt || best.edgeAt;
}

function nearest(cell, matrix, shown, point, near, scale, best) {
  for (const layer of shown) {
    const box = cell.boxes.get(layer);
    if (!box || apart(mappedBox(matrix, box), near)) continue;
    for (const some of cell.shapes.get(layer) || []) nearestOf(some, matrix, point, near, scale, best);
  }
  const seen = mappedBox(inverse(matrix), near);
  for (const group of cell.groups) {
    const size = group.cell.box;
    const pixels = Math.max(size[2] - size[0], size[3] - size[1]) * Math.hypot(matrix[0], matrix[1]) * scale;
    if (!(pixels >= SMALLEST_SEEN_PX)) continue;
    const turned = product(matrix, group.turn);
    eachPlaced(group, seen, (x, y) => {
      const [e, f] = mapped(matrix, x, y);
      nearest(group.cell, [turned[0], turned[1], turned[2], turned[3], e, f], shown, point, near, scale, best);
    });
  }
}

function nearestOf(some, matrix, point, near, scale, best) {
  const placed = product(matrix, [1, 0, 0, 1, some.box[0], some.box[1]]);
  const own = [0, 0, some.box[2] - some.box[0], some.box[3] - some.box[1]];
  const box = mappedBox(placed, own);
  if (apart(box, near) || Math.max(box[2] - box[0], box[3] - box[1]) * scale < SMALLEST_SEEN_PX) return;
  let start = 0;
  for (const end of some.ends) {
    let [x0, y0] = mapped(placed, some.points[end - 2], some.points[end - 1]);
    for (let place = start; place < end; place += 2) {
      const [x, y] = mapped(placed, some.points[place], some.points[place + 1]);
      const corner = Math.hypot(x - point[0], y - point[1]);
      if (corner < best.corner) [best.corner, best.cornerAt] = [corner, { x, y, on: "corner" }];
      const length = (x - x0) ** 2 + (y - y0) ** 2;
      const part = length ? Math.min(1, Math.max(0, ((point[0] - x0) * (x - x0) + (point[1] - y0) * (y - y0)) / length)) : 0;
      const [ex, ey] = [x0 + part * (x - x0), y0 + part * (y - y0)];
      const edge = Math.hypot(ex - point[0], ey - point[1]);
      if (edge < best.edge) [best.edge, best.edgeAt] = [edge, { x: ex, y: ey, on: "edge" }];
      [x0, y0] = [x, y];
    }
    start = end;
  }
}

/** Micrometres as text, to the nanometre. */
function micrometres(nm) {
  return `${(nm / 1000).toFixed(3).replace(/\.?0+$/, "").replace("-", "−") || "0"} µm`;
}

function distanceText(one, other) {
  const [x, y] = [other.x - one.x, other.y - one.y];
  const places = [one.on, other.on].map((on) => on || "anywhere").join(" to ");
  return `${micrometres(Math.hypot(x, y))} (x ${micrometres(x)}, y ${micrometres(y)}; ${places})`;
}
