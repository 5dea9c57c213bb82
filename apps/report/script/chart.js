// One chart: axes, zoom and cursor are uPlot's; what lies over them is drawn by layers.js and density.js.
import uPlot from "uplot";
import { axis_config, page_colour } from "./axes.js";
import { Density } from "./density.js";
import { draw_layer } from "./layers.js";
import { legend_of } from "./legend.js";
import { numbers_of } from "./packed_numbers.js";
import { Reader } from "./reader.js";
import { load_blocks } from "./section_points.js";
import { Window } from "./window.js";

/** "#a0b1c2" as three numbers. */
const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));

function unpacked(layer) {
  const layer_now = { ...layer };
  for (const key of ["x", "y", "lower", "upper"]) layer_now[key] = numbers_of(layer[key]);
  return layer_now;
}

export class Chart {
  /**
   * @param figure  the element with the still picture; the live chart is put beside it.
   * @param spec    what report_chart.cpp wrote: { name, title, views: [{ label, x, y, layers }] }.
   */
  constructor(figure, spec) {
    this.figure = figure;
    this.spec = spec;
    this.hidden = new Set(); // names of layers that the legend switched off
    this.live = document.createElement("div");
    this.live.className = "live";
    this.plot_place = document.createElement("div");
    this.plot_place.className = "plot";
    this.plot_place.tabIndex = 0;
    this.plot_place.setAttribute("role", "group");
    this.plot_place.setAttribute("aria-roledescription", "chart");
    this.plot_place.setAttribute("aria-label", `${spec.title}. Arrow keys move, plus and minus zoom, 0 shows all.`);
    this.live.append(this.#bar(), this.plot_place);
    this.legend_place = document.createElement("div");
    this.live.append(this.legend_place);
    figure.prepend(this.live);
    this.#set_view(0);
    figure.classList.add("drawn");
    new ResizeObserver(() => this.#resize()).observe(this.plot_place);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#set_view(this.index));
    this.window.listen(this.plot_place);
  }

  /** Buttons and, with several views, their choice. */
  #bar() {
    const bar = document.createElement("div");
    bar.className = "bar";
    if (this.spec.views.length > 1) {
      const label = document.createElement("label");
      const select = document.createElement("select");
      for (const view of this.spec.views) select.add(new Option(view.label));
      select.addEventListener("change", () => this.#set_view(select.selectedIndex));
      label.append(`${this.spec.choice ?? "Show"} `, select);
      bar.append(label);
    }
    this.readout = document.createElement("output");
    this.readout.setAttribute("aria-live", "off");
    bar.append(this.readout);
    for (const [text, name, act] of [
      ["+", "Zoom in", () => this.window.zoom(0.5)],
      ["−", "Zoom out", () => this.window.zoom(2)],
      ["All", "Show all", () => this.window.whole()],
    ]) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = text;
      button.setAttribute("aria-label", `${name}: ${this.spec.title}`);
      button.addEventListener("click", act);
      bar.append(button);
    }
    return bar;
  }

  #set_view(index) {
    const changed = index !== this.index;
    this.index = index;
    this.view = this.spec.views[index];
    if (changed) {
      this.layers = this.view.layers.map(unpacked);
      const { x, y } = this.view;
      if (this.window === undefined) this.window = new Window(() => this.#move());
      this.window.begin(x, y);
      this.density = this.layers.some((layer) => layer.kind === "density") ? (this.density ?? this.#load()) : null;
      this.reader = new Reader(this.layers, this.view);
    }
    for (const layer of this.layers) layer.colour = page_colour(layer.ink ?? `c${layer.style}`);
    this.paper = page_colour("paper");
    this.#build();
    this.legend_place.replaceChildren(
      legend_of(this.layers, this.hidden, () => this.plot.redraw(false)),
    );
  }

  #load() {
    const density = new Density();
    this.figure.dataset.points = "loading";
    load_blocks(this.spec.name, (block) => {
      density.add(block);
      this.#soon();
    }).then(() => {
      density.loaded = true;
      this.#soon();
      this.figure.dataset.points = String(density.blocks.reduce((sum, block) => sum + block.x.length, 0));
    });
    return density;
  }

  #size() {
    const width = Math.max(280, this.plot_place.clientWidth);
    return { width, height: Math.round(Math.min(560, Math.max(260, width * (this.view.height ?? 0.56)))) };
  }

  #build() {
    this.plot?.destroy();
    const { x, y } = this.view;
    const scale = (axis, [min, max]) => ({
      time: false, auto: false, distr: axis.log ? 3 : 1, min, max, range: (_, from, to) => [from, to],
    });
    const now = this.window.now;
    this.plot = new uPlot(
      {
        mode: 2,
        ...this.#size(),
        padding: [8, 12, 0, 0],
        legend: { show: false },
        scales: { x: scale(x, now.x), y: scale(y, now.y) },
        axes: [axis_config(x, "x", 2), axis_config(y, "y", 3)],
        // What is shown is drawn by our layers; uPlot wants at least one series.
        series: [null, { facets: [{ scale: "x", auto: false }, { scale: "y", auto: false }], paths: () => null, points: { show: false } }],
        cursor: {
          drag: { x: true, y: true, uni: 24, setScale: false },
          points: { show: false },
          bind: { dblclick: () => () => (this.window.whole(), null) },
        },
        hooks: {
          draw: [(u) => this.#draw(u)],
          setCursor: [(u) => this.#read(u)],
          setSelect: [(u) => this.#select(u)],
        },
      },
      [null, [[now.x[0], now.x[1]], [now.y[0], now.y[1]]]],
      this.plot_place,
    );
    // The picture is told in words and tables; the canvas itself says nothing to a reader.
    this.plot.root.querySelector("canvas").setAttribute("aria-hidden", "true");
  }

  #move() {
    const { x, y } = this.window.now;
    this.plot.batch(() => {
      this.plot.setScale("x", { min: x[0], max: x[1] });
      this.plot.setScale("y", { min: y[0], max: y[1] });
    });
  }

  #resize() {
    const size = this.#size();
    if (size.width !== this.plot.width) this.plot.setSize(size);
  }

  /** Draws again with the next frame. */
  #soon() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.plot.redraw(false);
    });
  }

  #draw(u) {
    const started = performance.now();
    const { left, top, width, height } = u.bbox;
    const context = u.ctx;
    const { x, y } = this.window.now;
    const position = (key, log, from, to, [lower, upper]) => {
      if (!log) return (value) => from + ((value - lower) / (upper - lower)) * (to - from);
      const [a, b] = [Math.log10(lower), Math.log10(upper)];
      return (value) => from + ((Math.log10(value) - a) / (b - a)) * (to - from);
    };
    const frame = {
      left, top, right: left + width, bottom: top + height, scale: uPlot.pxRatio, paper: this.paper,
      x: position("x", this.view.x.log, left, left + width, x),
      y: position("y", this.view.y.log, top + height, top, y),
      x_lower: x[0], x_upper: x[1], y_lower: y[0], y_log: this.view.y.log,
    };
    context.save();
    context.beginPath();
    context.rect(left, top, width, height);
    context.clip();
    for (const layer of this.layers) {
      if (this.hidden.has(layer.name)) continue;
      if (layer.kind === "density") this.#draw_density(context, layer, frame);
      else draw_layer(context, layer, frame);
    }
    if (this.reader.marked !== null) this.reader.mark(context, frame, page_colour("ink"));
    context.restore();
    this.figure.dataset.drawn = (performance.now() - started).toFixed(1);
  }

  #draw_density(context, layer, frame) {
    const [x, y] = [this.view.x, this.view.y];
    const share = (axis, value) => (value - axis.lower) / (axis.upper - axis.lower);
    const now = this.window.now;
    this.density.show({
      left: share(x, now.x[0]), right: share(x, now.x[1]), lower: share(y, now.y[0]), upper: share(y, now.y[1]),
      width: (frame.right - frame.left) / frame.scale, height: (frame.bottom - frame.top) / frame.scale,
    });
    const counted = this.density.count();
    if (!counted) this.#soon();
    this.figure.setAttribute("aria-busy", String(!counted || !this.density.loaded));
    context.imageSmoothingEnabled = false;
    context.drawImage(this.density.painted(rgb(layer.colour)), frame.left, frame.top, frame.right - frame.left, frame.bottom - frame.top);
  }

  #select(u) {
    const { left, top, width, height } = u.select;
    if (width < 4 && height < 4) return;
    const whole_x = width < 4 || width >= u.over.clientWidth - 1;
    const whole_y = height < 4 || height >= u.over.clientHeight - 1;
    const { x, y } = this.window.now;
    this.window.set(
      whole_x ? x : [u.posToVal(left, "x"), u.posToVal(left + width, "x")],
      whole_y ? y : [u.posToVal(top + height, "y"), u.posToVal(top, "y")],
    );
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }

  #read(u) {
    const { left, top } = u.cursor;
    const outside = !(left >= 0 && top >= 0);
    const before = this.reader.marked;
    this.readout.textContent = outside ? "" : this.reader.text(u, left, top, this.hidden);
    if (outside) this.reader.marked = null;
    const same = before === this.reader.marked ||
      (before && this.reader.marked && before.x === this.reader.marked.x && before.y === this.reader.marked.y);
    if (!same) this.#soon();
  }
}
