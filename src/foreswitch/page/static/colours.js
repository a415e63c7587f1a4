// Colours of lines and the font of axes, as the style sheet has them for light, dark and print.

const NAMES = [
  "ink",
  "soft",
  "grid",
  "paper",
  "output",
  "reference",
  "band",
  "command",
  "landing",
  "other-1",
  "other-2",
  "other-3",
  "other-4",
];
/** Beside its colour, each overlay has its own dashes, for readers who see no colours [px]. */
export const DASHES = [[8, 3], [2, 3], [10, 3, 2, 3], [5, 5]];

/** @returns {Record<string, string>} */
export function colours() {
  const probe = document.createElement("i");
  document.body.append(probe);
  const found = Object.fromEntries(NAMES.map((name) => {
    probe.style.color = `var(--${name})`;
    return [name, getComputedStyle(probe).color];
  }));
  probe.remove();
  return found;
}

/** @returns {string} of the figures at the axes, as large as the small print of the page */
export function axisFont() {
  return `${Math.round(0.8 * parseFloat(getComputedStyle(document.documentElement).fontSize))}px system-ui, sans-serif`;
}

/**
 * @param {number} i of an overlay
 * @returns {string} name of its colour
 */
export const otherColour = (i) => `other-${(i % 4) + 1}`;
