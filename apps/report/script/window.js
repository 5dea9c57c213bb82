// The part of a chart that is in view: moved by buttons, keys, wheel and drag, held inside the whole.

/** How deep one may look: beyond it the steps of packed numbers would show. */
const deepest = 1 / 64;

export class Window {
  /** @param moved  called after each change. */
  constructor(moved) {
    this.moved = moved;
  }

  /** Whole axes of a view. Inside, logarithmic axes are handled by their logarithms. */
  begin(x, y) {
    this.axes = { x, y };
    this.inner = { x: this.#whole("x"), y: this.#whole("y") };
  }

  #to(key, value) {
    return this.axes[key].log ? Math.log10(value) : value;
  }

  #from(key, value) {
    return this.axes[key].log ? 10 ** value : value;
  }

  #whole(key) {
    const axis = this.axes[key];
    return [this.#to(key, axis.lower), this.#to(key, axis.upper)];
  }

  /** Ends of what is in view, in the units of the axes. */
  get now() {
    return { x: this.inner.x.map((v) => this.#from("x", v)), y: this.inner.y.map((v) => this.#from("y", v)) };
  }

  #hold(key, [lower, upper]) {
    const [first, last] = this.#whole(key);
    const depth = this.axes[key].deep ? 1e-5 : deepest;
    const width = Math.min(last - first, Math.max((last - first) * depth, upper - lower));
    const middle = Math.min(last - 0.5 * width, Math.max(first + 0.5 * width, 0.5 * (lower + upper)));
    return [middle - 0.5 * width, middle + 0.5 * width];
  }

  #show(x, y) {
    this.inner = { x: this.#hold("x", x), y: this.#hold("y", y) };
    this.moved();
  }

  set(x, y) {
    this.#show(x.map((v) => this.#to("x", v)), y.map((v) => this.#to("y", v)));
  }

  whole() {
    this.#show(this.#whole("x"), this.#whole("y"));
  }

  /** @param factor  of the width in view; @param at  shares of the frame that stay where they are. */
  zoom(factor, at = { x: 0.5, y: 0.5 }) {
    const zoomed = (key) => {
      const [lower, upper] = this.inner[key];
      const fixed = lower + at[key] * (upper - lower);
      return [fixed + factor * (lower - fixed), fixed + factor * (upper - fixed)];
    };
    this.#show(zoomed("x"), zoomed("y"));
  }

  /** By shares of what is in view. */
  pan(right, up) {
    const moved = (key, share) => this.inner[key].map((v) => v + share * (this.inner[key][1] - this.inner[key][0]));
    this.#show(moved("x", right), moved("y", up));
  }

  /** Keys, and the wheel while Ctrl is held (so that the page scrolls otherwise). */
  listen(element) {
    const keys = {
      ArrowLeft: () => this.pan(-0.2, 0), ArrowRight: () => this.pan(0.2, 0),
      ArrowUp: () => this.pan(0, 0.2), ArrowDown: () => this.pan(0, -0.2),
      "+": () => this.zoom(0.5), "=": () => this.zoom(0.5), "-": () => this.zoom(2),
      0: () => this.whole(), Escape: () => this.whole(),
    };
    element.addEventListener("keydown", (event) => {
      const act = event.ctrlKey || event.altKey || event.metaKey ? undefined : keys[event.key];
      if (act === undefined) return;
      event.preventDefault();
      act();
    });
    element.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      const over = element.querySelector(".u-over").getBoundingClientRect();
      const at = { x: (event.clientX - over.left) / over.width, y: 1 - (event.clientY - over.top) / over.height };
      this.zoom(2 ** (Math.sign(event.deltaY) * 0.4), at);
    }, { passive: false });
  }
}
