// What the layers of a chart are called; each name switches its layers off and on.
import { marker_outline, radius_of } from "./layers.js";

const svg = "http://www.w3.org/2000/svg";

function key_of(layer) {
  const picture = document.createElementNS(svg, "svg");
  for (const [name, value] of Object.entries({ width: 18, height: 14, viewBox: "0 0 18 14", "aria-hidden": "true" })) {
    picture.setAttribute(name, value);
  }
  const path = document.createElementNS(svg, "path");
  if (layer.kind === "points") {
    path.setAttribute("d", marker_outline(layer.style, 9, 7, radius_of(layer.style)));
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
