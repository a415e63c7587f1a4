// Between a slider's position, 0 to 1, and a value.

/** @typedef {{low: number, high: number, value: (share: number) => number, share: (value: number) => number}} Scale */

/** Slider positions are whole numbers up to this. */
export const STEPS = 1000;

/**
 * A round number (1, 2 or 5 times a power of ten) not below a positive one.
 * @param {number} value
 * @returns {number}
 */
export function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  const factor = [1, 2, 5, 10].find((each) => each * power >= value * (1 - 1e-9));
  return clean(factor * power);
}

/**
 * Without the digits that binary arithmetic leaves behind.
 * @param {number} value
 * @param {number} [digits] significant ones
 * @returns {number}
 */
export function clean(value, digits = 12) {
  return Number(value.toPrecision(digits));
}

/**
 * A value as text, short but not misleading.
 * @param {number|null|undefined} value
 * @param {number} [digits] significant ones
 * @returns {string}
 */
export function show(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (Number.isInteger(value) && Math.abs(value) < 1e6) return String(value);
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-4) return value.toExponential(digits - 1).replace("e+", "e");
  return String(size >= 10 ** digits ? Math.round(value) : clean(value, digits));
}

/**
 * Three decades about a value, its sign kept: round ends, so that the range does not wander with the value.
 * @param {number} value not zero
 * @returns {Scale}
 */
export function decades(value) {
  const sign = Math.sign(value);
  const first = Math.floor(Math.log10(Math.abs(value))) - 1;
  const share = (each) => (each * sign > 0 ? (Math.log10(each * sign) - first) / 3 : -1);
  return {
    low: sign * 10 ** first,
    high: sign * 10 ** (first + 3),
    value: (place) => clean(sign * 10 ** (first + 3 * place), 3),
    share,
  };
}

/**
 * From zero, fine at its lower end.
 * @param {number} high
 * @returns {Scale}
 */
export function fromZero(high) {
  return {
    low: 0,
    high,
    value: (place) => clean(high * place ** 2, 3),
    share: (value) => (value < 0 ? -1 : Math.sqrt(value / high)),
  };
}

/**
 * Even, from low to high.
 * @param {number} low
 * @param {number} high
 * @param {number} [step] values are multiples of it
 * @returns {Scale}
 */
export function even(low, high, step = (high - low) / 200) {
  return {
    low,
    high,
    value: (place) => clean(Math.round((low + (high - low) * place) / step) * step),
    share: (value) => (value - low) / (high - low),
  };
}
