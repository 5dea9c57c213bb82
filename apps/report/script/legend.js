// What the layers of a chart are called; each name switches its layers off and on.
import { radius_of, shape_of } from "./layers.js";

const svg = "http://www.w3.org/2000/svg";

/** Outlines of the markers of layers.js around (9, 7). */
function marker_path(shape, r) {
  switch (shape) {
    case "square":
      return `M${9 - 0.88 * r} ${7 - 0.88 * r}h${1.76 * r}v${1.76 * r}h${-1.76 * r}z`;
    case "triangle":
      return `M9 ${7 - 1.2 * r}l${1.1 * r} ${1.9 * r}h${-2.2 * r}z`;
    case "down":
      return `M9 ${7 + 1.2 * r}l${1.1 * r} ${-1.9 * r}h${-2.2 * r}z`;
    case "diamond":
      return `M9 ${7 - 1.2 * r}l${1.2 * r} ${1.2 * r}l${-1.2 * r} ${1.2 * r}l${-1.2 * r} ${-1.2 * r}z`;
    default:
      return `M${9 - r} 7a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0z`;
  }
}

function key_of(layer) {
  const picture = document.createElementNS(svg, "svg");
  for (const [name, value] of Object.entries({ width: 18, height: 14, viewBox: "0 0 18 14", "aria-hidden": "true" })) {
    picture.setAttribute(name, value);
  }
  const path = document.createElementNS(svg, "path");
  if (layer.kind === "points") {
    path.setAttribute("d", marker_path(shape_of(layer.style), radius_of(layer.style)));
    if (layer.open) {
      path.setAttribute("fill", "none");
      path.setAttribute("stroke", layer.colour);
    } else path.setAttribute("fill", layer.colour);
  } else if (layer.kind === "density" || layer.kind === "band" || layer.kind === "bars") {
    path.setAttribute("d", "M2 2h14v10h-14z");
    path.setAttribute("fill", layer.colour);
    path.setAttribute("fill-opacity", "0.5");
  } else {
    path.setAttribute("d", "M1 7h16");
    path.setAttribute("stroke", layer.colour);
    path.setAttribute("stroke-width", "2");
    if (layer.dash) path.setAttribute("stroke-dasharray", "5 3");
  }
  picture.append(path);
  return picture;
}

/** A list of buttons, one per name. @param hidden  set of names that are off; @param changed  called after a switch. */
export function legend_of(layers, hidden, changed) {
  const list = document.createElement("div");
  list.className = "legend";
  const seen = new Set();
  for (const layer of layers) {
    if (!layer.name || seen.has(layer.name)) continue;
    seen.add(layer.name);
    const button = document.createElement("button");
    button.type = "button";
    button.append(key_of(layer), layer.name);
    button.setAttribute("aria-pressed", String(!hidden.has(layer.name)));
    button.addEventListener("click", () => {
      const off = !hidden.delete(layer.name);
      if (off) hidden.add(layer.name);
      button.setAttribute("aria-pressed", String(!off));
      changed();
    });
    list.append(button);
  }
  return list;
}
