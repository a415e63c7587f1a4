// What all charts have alike: axes, lines, a name above each.

import { axisFont } from "./colours.js";
import { make } from "./dom.js";
import { show } from "./scale.js";

/** @typedef {any} Chart uPlot's */

/** Comes with a script of its own, before the modules. */
const { uPlot } = /** @type {any} */ (globalThis);

/** Width of the axes at the left [px]: that of "-1000000". */
const AXIS = 62;
/** Height of an axis of time [px]. */
const FOOT = 30;

/** Figures at an axis, as short as they can be. */
const ticks = (_chart, splits) => splits.map((each) => show(each, 6));

/**
 * @param {Record<string, string>} palette
 * @param {object} [more] as uPlot has it
 * @returns {object} uPlot's options of the axis of time
 */
export const timeAxis = (palette, more = {}) => axis(palette, { size: FOOT, ...more });

/**
 * @param {Record<string, string>} palette
 * @param {object} [more] as uPlot has it
 * @returns {object} uPlot's options of the axis of values
 */
export const valueAxis = (palette, more = {}) => axis(palette, { size: AXIS, ...more });

function axis(palette, more) {
  return {
    stroke: palette.soft,
    grid: { stroke: palette.grid, width: 1 },
    ticks: { stroke: palette.grid, width: 1, size: 4 },
    font: axisFont(),
    values: ticks,
    ...more,
  };
}

/**
 * @param {Record<string, string>} palette
 * @param {string} colour its name in the palette
 * @param {{width?: number, dash?: number[], stairs?: boolean}} [more]
 * @returns {object} uPlot's options of a series
 */
export function line(palette, colour, { width = 1.5, dash, stairs = false } = {}) {
  const paths = stairs ? { paths: uPlot.paths.stepped({ align: 1 }) } : {};
  return { stroke: palette[colour], width, dash, points: { show: false }, ...paths };
}

/**
 * A chart with its name above it.
 * @param {string} name
 * @param {object} options uPlot's, without size
 * @param {any} data uPlot's
 * @param {string} [className] beside "chart"
 * @returns {{chart: Chart, parts: Element[]}}
 */
export function named(name, options, data, className = "") {
  const box = make("div", { className: `chart ${className}`.trim() });
  const common = { width: 100, height: 60, padding: [6, 12, 0, 0], legend: { show: false } };
  const chart = new uPlot({ ...common, ...options }, data, box);
  return { chart, parts: [make("p", { className: "chart-name" }, name), box] };
}

/**
 * What the names above charts leave free of a place's height.
 * @param {HTMLElement} root
 * @returns {number} [px]
 */
export function freeHeight(root) {
  const names = /** @type {NodeListOf<HTMLElement>} */ (root.querySelectorAll(".chart-name"));
  return root.clientHeight - [...names].reduce((sum, each) => sum + each.offsetHeight, 0);
}
