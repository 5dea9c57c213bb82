// Numbers as report_chart.cpp packs them: a plain list, an even grid, or whole steps between two ends in base64.

/** The bytes of a base64 text. */
export function bytes_of(text) {
  const binary = atob(text.trim());
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; ++i) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

/** Values of a packed list as doubles; what is undefined is NaN. The ends are exact, values between them to half a step. */
export function numbers_of(packed) {
  if (packed === undefined || packed === null) return new Float64Array(0);
  if (Array.isArray(packed)) return Float64Array.from(packed, (value) => (value === null ? NaN : value));
  if (packed.step !== undefined) {
    return Float64Array.from({ length: packed.count }, (_, i) => packed.from + i * packed.step);
  }
  const bytes = bytes_of(packed.base64);
  const view = new DataView(bytes.buffer);
  const width = packed.bits / 8;
  const undefined_code = 2 ** packed.bits - 1;
  const values = new Float64Array(bytes.length / width);
  for (let i = 0; i < values.length; ++i) {
    const code = width === 2 ? view.getUint16(2 * i, true) : view.getUint32(4 * i, true);
    const share = code / (undefined_code - 1);
    values[i] = code === undefined_code ? NaN : packed.lower * (1 - share) + packed.upper * share;
  }
  return values;
}
