// Axes of charts: which ticks they have, and how these are written.

const font = '13px system-ui, "Helvetica Neue", Arial, "DejaVu Sans", sans-serif';

/** A colour of the page by its name, as it is now (light or dark). */
export const page_colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

const title_of = (axis) => (axis.unit ? `${axis.label} [${axis.unit}]` : axis.label);

/** An axis of uPlot for an axis of a view. @param side  2: below, 3: to the left. */
export function axis_config(axis, scale, side) {
  const ink = page_colour("soft");
  const grid = { stroke: page_colour("grid"), width: 1 };
  const config = { scale, side, stroke: ink, grid, ticks: { ...grid, size: 5 }, font, labelFont: font };
  if (axis.label) Object.assign(config, { label: title_of(axis), labelSize: 22, labelGap: 2 });
  if (axis.whole) config.incrs = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 10000];
  if (axis.names) {
    config.splits = () => axis.names.map((_, i) => i);
    config.values = (_, splits) => splits.map((i) => axis.names[i] ?? "");
  } else if (axis.circle) {
    config.splits = (_, __, from, to) => circle_ticks(from, to);
    config.values = (_, splits) => splits.map(pi_text);
  } else if (axis.log) {
    // Lines and numbers at powers of ten, and between them while few are in view.
    const few = Math.log10(axis.upper / axis.lower) < 1.5;
    const shown = (value) => value !== null && (few || is_power(value));
    const filter = (_, splits) => splits.map((value) => (shown(value) ? value : null));
    config.grid = { ...grid, filter };
    config.ticks = { ...config.ticks, filter };
    config.values = (_, splits) => splits.map((value) => (shown(value) ? number_text(value) : ""));
    config.filter = filter;
  } else {
    config.values = (_, splits) => {
      const most = Math.max(...splits.map(Math.abs));
      const plain = most < 1e5 && most >= 1e-3;
      return splits.map((value) => (plain || value === 0 ? minus(String(Number(value.toPrecision(10)))) : shortened(value)));
    };
  }
  if (side === 2) config.size = 32;
  else {
    // As wide as the longest label.
    config.size = (u, values) => {
      u.ctx.font = font;
      const widest = Math.max(20, ...(values ?? []).map((text) => u.ctx.measureText(text ?? "").width));
      return Math.ceil(widest) + 14;
    };
  }
  return config;
}

/** Multiples of a part of pi, at least four in view. */
function circle_ticks(from, to) {
  let step = Math.PI / 2;
  while ((to - from) / step < 4) step /= 2;
  const first = Math.ceil(from / step - 1e-9);
  const last = Math.floor(to / step + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, i) => (first + i) * step);
}

/** 3 pi / 4 as "3\u03c0/4". */
function pi_text(angle) {
  for (const parts of [1, 2, 4, 8, 16, 32, 64, 128, 256]) {
    const count = Math.round((angle * parts) / Math.PI);
    if (Math.abs((angle * parts) / Math.PI - count) > 1e-6) continue;
    if (count === 0) return "0";
    return `${count < 0 ? "\u2212" : ""}${Math.abs(count) === 1 ? "" : Math.abs(count)}\u03c0${parts === 1 ? "" : `/${parts}`}`;
  }
  return minus(String(Number(angle.toPrecision(4))));
}

const minus = (text) => text.replace("-", "\u2212");

/** 1.2e-7 and the like, short. */
function shortened(value) {
  return minus(value.toExponential(2).replace(/\.?0+e/, "e").replace("e+", "e").replace("e-", "e\u2212"));
}

const is_power = (value) => Math.abs(Math.log10(value) - Math.round(Math.log10(value))) < 1e-6;

/** 1000 as "1000", 1e9 as "1e9". */
function number_text(value) {
  return value >= 1e-3 && value <= 1e4 ? String(Number(value.toPrecision(6))) : shortened(value);
}
