// What a chart draws over its axes, layer by layer. Positions are canvas pixels; `scale` is the screen's pixel ratio.

/** Names of the shapes by style, 1 to 8; the same as in the program's own pictures (plot_marker.cpp). */
const shapes = ["circle", "square", "triangle", "diamond", "down", "circle", "square", "diamond"];
/** Half sizes of these markers [px]. */
const radii = [5.6, 5.0, 4.6, 4.0, 3.8, 3.0, 2.6, 2.8];

export const radius_of = (style) => radii[(style - 1) % 8];

/** The outline of a marker around (x, y), as SVG path data. */
export function marker_outline(style, x, y, r) {
  switch (shapes[(style - 1) % 8]) {
    case "square":
      return `M${x - 0.88 * r} ${y - 0.88 * r}h${1.76 * r}v${1.76 * r}h${-1.76 * r}z`;
    case "triangle":
      return `M${x} ${y - 1.2 * r}l${1.1 * r} ${1.9 * r}h${-2.2 * r}z`;
    case "down":
      return `M${x} ${y + 1.2 * r}l${1.1 * r} ${-1.9 * r}h${-2.2 * r}z`;
    case "diamond":
      return `M${x} ${y - 1.2 * r}l${1.2 * r} ${1.2 * r}l${-1.2 * r} ${1.2 * r}l${-1.2 * r} ${-1.2 * r}z`;
    default:
      return `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0z`;
  }
}

function draw_points(context, layer, frame) {
  // Dense clouds of unlabelled points get dots that let each other be seen, less dense ones small marks without edge.
  const dots = !layer.labels && layer.x.length > 3000;
  const small = !layer.labels && layer.x.length > 120;
  const r = (dots ? 1.5 : small ? 0.7 * radius_of(layer.style) : radius_of(layer.style)) * frame.scale;
  const path = new Path2D();
  const outlines = [];
  for (let i = 0; i < layer.x.length; ++i) {
    const x = frame.x(layer.x[i]);
    const y = frame.y(layer.y[i]);
    if (!(x > frame.left - 9 && x < frame.right + 9 && y > frame.top - 9 && y < frame.bottom + 9)) continue;
    if (dots) path.rect(x - r, y - r, 2 * r, 2 * r);
    else outlines.push(marker_outline(layer.style, x, y, r));
  }
  path.addPath(new Path2D(outlines.join("")));
  context.globalAlpha = dots ? 0.45 : small ? 0.7 : 1;
  if (layer.open) {
    context.lineWidth = 1.6 * frame.scale;
    context.strokeStyle = layer.colour;
    context.stroke(path);
  } else {
    context.fillStyle = layer.colour;
    context.fill(path);
    if (!small) {
      context.lineWidth = 0.8 * frame.scale;
      context.strokeStyle = frame.paper;
      context.stroke(path);
    }
  }
  context.globalAlpha = 1;
}

/** First index with x[i] >= value, for x that rises. */
function first_from(x, value) {
  let low = 0;
  let high = x.length;
  while (low < high) {
    const middle = (low + high) >>> 1;
    if (x[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** A polyline; of long ones only what is in view, and of each pixel column the first, lowest, highest, last value. */
function draw_line(context, layer, frame) {
  const { x, y } = layer;
  const from = layer.rising ? Math.max(0, first_from(x, frame.x_lower) - 1) : 0;
  const to = layer.rising ? Math.min(x.length, first_from(x, frame.x_upper) + 1) : x.length;
  const path = new Path2D();
  const thin = layer.rising && to - from > 4 * (frame.right - frame.left);
  let open = false;
  let column = NaN;
  let low = 0;
  let high = 0;
  let last = 0;
  const flush = () => {
    if (Number.isNaN(column)) return;
    path.lineTo(column, low);
    path.lineTo(column, high);
    path.lineTo(column, last);
  };
  for (let i = from; i < to; ++i) {
    const px = frame.x(x[i]);
    const py = frame.y(y[i]);
    if (!Number.isFinite(px) || !Number.isFinite(py)) {
      if (thin) flush();
      open = false;
      column = NaN;
      continue;
    }
    if (!open) {
      path.moveTo(px, py);
      open = true;
    }
    if (!thin) {
      path.lineTo(px, py);
      continue;
    }
    const here = Math.round(px);
    if (here !== column) {
      flush();
      column = here;
      low = high = py;
    }
    low = Math.max(low, py);
    high = Math.min(high, py);
    last = py;
  }
  if (thin) flush();
  context.lineWidth = (layer.width ?? 1.6) * frame.scale;
  context.setLineDash(layer.dash ? [6 * frame.scale, 4 * frame.scale] : []);
  context.lineJoin = "round";
  context.strokeStyle = layer.colour;
  context.stroke(path);
  context.setLineDash([]);
}

function draw_band(context, layer, frame) {
  const path = new Path2D();
  for (let i = 0; i < layer.x.length; ++i) path.lineTo(frame.x(layer.x[i]), frame.y(layer.upper[i]));
  for (let i = layer.x.length - 1; i >= 0; --i) path.lineTo(frame.x(layer.x[i]), frame.y(layer.lower[i]));
  path.closePath();
  context.globalAlpha = 0.2;
  context.fillStyle = layer.colour;
  context.fill(path);
  context.globalAlpha = 1;
}

/** Columns from zero; `x` holds the edges, one more than heights. */
function draw_bars(context, layer, frame) {
  const path = new Path2D();
  const zero = frame.y(frame.y_log ? frame.y_lower : 0);
  for (let i = 0; i < layer.y.length; ++i) {
    const left = frame.x(layer.x[i]);
    const right = frame.x(layer.x[i + 1]);
    const top = frame.y(layer.y[i]);
    path.rect(left, top, right - left, zero - top);
  }
  context.fillStyle = layer.colour;
  context.globalAlpha = 0.35;
  context.fill(path);
  context.globalAlpha = 1;
  context.lineWidth = frame.scale;
  context.strokeStyle = layer.colour;
  context.stroke(path);
}

/** Intervals along x at heights y, with feet; or upright ones at x. */
function draw_intervals(context, layer, frame) {
  const path = new Path2D();
  const foot = 5 * frame.scale;
  for (let i = 0; i < layer.lower.length; ++i) {
    if (layer.x.length > 0) {
      path.moveTo(frame.x(layer.x[i]), frame.y(layer.lower[i]));
      path.lineTo(frame.x(layer.x[i]), frame.y(layer.upper[i]));
      continue;
    }
    const y = frame.y(layer.y[i]);
    const ends = [frame.x(layer.lower[i]), frame.x(layer.upper[i])];
    path.moveTo(ends[0], y);
    path.lineTo(ends[1], y);
    for (const x of ends) {
      path.moveTo(x, y - foot);
      path.lineTo(x, y + foot);
    }
  }
  context.lineWidth = (layer.x.length > 0 ? 1.2 : 2) * frame.scale;
  context.strokeStyle = layer.colour;
  context.stroke(path);
}

/** A straight line over the whole plot at one value of x or y. */
function draw_rule(context, layer, frame) {
  const path = new Path2D();
  if (layer.at_x !== undefined) {
    path.moveTo(frame.x(layer.at_x), frame.top);
    path.lineTo(frame.x(layer.at_x), frame.bottom);
  } else {
    path.moveTo(frame.left, frame.y(layer.at_y));
    path.lineTo(frame.right, frame.y(layer.at_y));
  }
  context.lineWidth = 1.4 * frame.scale;
  context.setLineDash(layer.dash ? [6 * frame.scale, 4 * frame.scale] : []);
  context.strokeStyle = layer.colour;
  context.stroke(path);
  context.setLineDash([]);
}

const drawers = {
  points: draw_points,
  line: draw_line,
  band: draw_band,
  bars: draw_bars,
  intervals: draw_intervals,
  rule: draw_rule,
};

/** Draws one layer; a kind that is not known here is the program's mistake and is said. */
export function draw_layer(context, layer, frame) {
  const draw = drawers[layer.kind];
  if (draw === undefined) throw new Error(`chart layer of unknown kind "${layer.kind}"`);
  draw(context, layer, frame);
}
