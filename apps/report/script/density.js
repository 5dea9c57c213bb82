// Points too many to draw one by one: counted per cell of the screen, shown as shades.

/** Longest time of one go [ms]: a quarter of the 50 ms from which browsers call a task long. */
const slice_ms = 12;

/** Side of a cell [px]. Few points in view: larger cells, so that single points are seen. */
const side_of_cells = (points) => (points < 3000 ? 3 : points < 40000 ? 2 : 1);

/** Counts points of blocks into cells, over as many frames as it takes, and paints what is counted. */
export class Density {
  constructor() {
    this.blocks = [];
    this.loaded = false; // all blocks have come
    this.canvas = document.createElement("canvas");
    this.view = null;
    this.next = 0; // first block that is not counted
    this.seen = 0; // points counted in this view
  }

  add(block) {
    this.blocks.push(block);
  }

  /** What is shown from now on: shares of the axes (0 to 1) at the edges, width and height [px]. */
  show(view) {
    const old = this.view;
    const same = old !== null && Object.keys(view).every((key) => view[key] === old[key]);
    if (!same) this.#begin(view, 1);
  }

  #begin(view, side) {
    this.side = side;
    const columns = Math.max(1, Math.round(view.width / side));
    const rows = Math.max(1, Math.round(view.height / side));
    this.view = { ...view, columns, rows };
    const cells = columns * rows;
    if (this.counts?.length === cells) this.counts.fill(0);
    else this.counts = new Uint32Array(cells);
    this.most = 1; // points of the fullest cell
    this.next = 0;
    this.seen = 0;
  }

  /** Counts for one slice of time; true when all blocks that have come are counted, in cells of the right size. */
  count() {
    const end = performance.now() + slice_ms;
    while (this.next < this.blocks.length) {
      this.#count(this.blocks[this.next++]);
      if (performance.now() > end) break;
    }
    if (this.next < this.blocks.length) return false;
    // How many points are in view is known now, and not before: a part of them would ask for other cells.
    const side = this.loaded ? side_of_cells(this.seen) : this.side;
    if (side === this.side) return true;
    this.#begin(this.view, side);
    return this.count();
  }

  #count(block) {
    const { left, right, lower, upper, columns, rows } = this.view;
    const [x0, x1, y0, y1] = [left * 65535, right * 65535, lower * 65535, upper * 65535];
    const { box, x, y } = block;
    if (box.right < x0 || box.left > x1 || box.upper < y0 || box.lower > y1) return;
    const across = columns / (x1 - x0);
    const up = rows / (y1 - y0);
    const counts = this.counts;
    let seen = 0;
    let most = this.most;
    for (let i = 0; i < x.length; ++i) {
      const column = ((x[i] - x0) * across) | 0;
      const row = ((y1 - y[i]) * up) | 0;
      if (x[i] >= x0 && y[i] <= y1 && column < columns && row < rows) {
        const count = ++counts[row * columns + column];
        if (count > most) most = count;
        ++seen;
      }
    }
    this.seen += seen;
    this.most = most;
  }

  /** A canvas of one pixel per cell: the more points, the stronger the colour, by the logarithm. */
  painted([red, green, blue]) {
    const { columns, rows } = this.view;
    const { canvas, counts } = this;
    if (canvas.width !== columns || canvas.height !== rows || !this.image) {
      canvas.width = columns;
      canvas.height = rows;
      this.image = new ImageData(columns, rows);
    }
    const pixels = new Uint32Array(this.image.data.buffer);
    const most = this.most;
    const colour = red | (green << 8) | (blue << 16);
    // A single point is seen, too: a third of full strength where others hold many.
    const strengths = Uint32Array.from({ length: 256 }, (_, k) => {
      const strength = most === 1 ? 0.8 : 0.34 + (0.6 * Math.log(Math.max(1, k))) / Math.log(Math.min(255, most));
      return (colour | (Math.round(255 * Math.min(0.94, strength)) << 24)) >>> 0;
    });
    for (let i = 0; i < pixels.length; ++i) {
      const count = counts[i];
      pixels[i] = count === 0 ? 0 : strengths[count > 255 ? 255 : count];
    }
    canvas.getContext("2d").putImageData(this.image, 0, 0);
    return canvas;
  }
}
