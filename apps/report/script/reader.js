// What lies under the cursor, in words.

/** Farthest a marker may be from the cursor to be meant [px]. */
const reach = 14;

const rounded = (value) => String(Number(value.toPrecision(6)));

export class Reader {
  constructor(layers, view) {
    this.layers = layers.filter((layer) => layer.kind === "points" || layer.kind === "line");
    this.view = view;
    this.marked = null; // the point that the text is about
  }

  /** The nearest point within reach, or the place itself. */
  text(u, left, top, hidden) {
    let best = reach * reach;
    let found = null;
    const place = { x: u.posToVal(left, "x"), y: u.posToVal(top, "y") };
    const from = u.posToVal(left - reach, "x");
    const to = u.posToVal(left + reach, "x");
    for (const layer of this.layers) {
      if (hidden.has(layer.name)) continue;
      for (let i = 0; i < layer.x.length; ++i) {
        if (!(layer.x[i] >= from && layer.x[i] <= to)) continue;
        const dx = u.valToPos(layer.x[i], "x") - left;
        const dy = u.valToPos(layer.y[i], "y") - top;
        const square = dx * dx + dy * dy;
        if (square < best) {
          best = square;
          found = { layer, i };
        }
      }
    }
    const { x, y } = this.view;
    const named = (axis, value) => (axis.names ? (axis.names[Math.round(value)] ?? "") :
      `${axis.label || "value"} ${rounded(value)}${axis.unit && axis.unit !== "1" ? ` ${axis.unit}` : ""}`);
    if (found === null) {
      this.marked = null;
      return `${named(x, place.x)}, ${named(y, place.y)}`;
    }
    const { layer, i } = found;
    this.marked = { x: layer.x[i], y: layer.y[i] };
    const label = layer.labels?.[i] ?? layer.name;
    return `${label ? `${label}: ` : ""}${named(x, layer.x[i])}, ${named(y, layer.y[i])}`;
  }

  mark(context, frame, colour) {
    context.beginPath();
    context.arc(frame.x(this.marked.x), frame.y(this.marked.y), 9 * frame.scale, 0, 2 * Math.PI);
    context.lineWidth = 1.5 * frame.scale;
    context.strokeStyle = colour;
    context.stroke();
  }
}
