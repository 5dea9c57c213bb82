// A million points in blocks that report_points.cpp wrote: both coordinates in 16 bits, interleaved to one number,
// sorted, and the differences in seven bits per byte. Neighbours in a block are neighbours in the plane.
import { bytes_of } from "./packed_numbers.js";

/** Every second bit of a 32-bit number, from the lowest. */
function every_second_bit(value) {
  let x = value & 0x55555555;
  x = (x | (x >>> 1)) & 0x33333333;
  x = (x | (x >>> 2)) & 0x0f0f0f0f;
  x = (x | (x >>> 4)) & 0x00ff00ff;
  return (x | (x >>> 8)) & 0x0000ffff;
}

/** One block: coordinates as steps of 1/65535 of the axis, and the box around them. */
export function decoded_block(text, count) {
  const bytes = bytes_of(text);
  const x = new Uint16Array(count);
  const y = new Uint16Array(count);
  const box = { left: 65535, right: 0, lower: 65535, upper: 0 };
  let key = 0;
  let at = 0;
  for (let i = 0; i < count; ++i) {
    let difference = 0;
    let shift = 1;
    let byte = 0;
    do {
      byte = bytes[at++];
      difference += (byte & 127) * shift;
      shift *= 128;
    } while (byte > 127);
    key += difference; // below 2^32: exact in a double
    const a = every_second_bit(key | 0);
    const b = every_second_bit(key >>> 1);
    x[i] = a;
    y[i] = b;
    if (a < box.left) box.left = a;
    if (a > box.right) box.right = a;
    if (b < box.lower) box.lower = b;
    if (b > box.upper) box.upper = b;
  }
  return { x, y, box };
}

/** Lets the page paint and answer before more is done. */
const breath = () => new Promise((resolve) => setTimeout(resolve, 0));

/**
 * Decodes the blocks of a chart one after the other, each in a task of its own.
 * @param arrived  called with each block as it comes.
 */
export async function load_blocks(name, arrived) {
  for (const element of document.querySelectorAll(`script[data-points="${CSS.escape(name)}"]`)) {
    await breath();
    arrived(decoded_block(element.textContent, Number(element.dataset.count)));
  }
}
