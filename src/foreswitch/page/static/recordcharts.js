// A record with the fit over it, and the averaged response to its pulses.

import { freeHeight, line, named, timeAxis, valueAxis } from "./charts.js";
import { colours } from "./colours.js";
import { area, inside } from "./strokes.js";

/** A chart is at least so high [px]. */
const LEAST = 90;

/**
 * @typedef {object} Part one chart
 * @property {string} title
 * @property {Float32Array} t
 * @property {boolean} [tall] twice as high as others
 * @property {{values: Float32Array, colour: string, width?: number, dash?: number[], stairs?: boolean}[]} lines
 * @property {{low: Float32Array, high: Float32Array}} [band]
 */

/**
 * @param {HTMLElement} root
 * @returns {{show: (parts: Part[]) => void}}
 */
export function recordCharts(root) {
  let charts = []; // {chart, tall}

  function build(parts) {
    for (const { chart } of charts) chart.destroy();
    const palette = colours();
    const made = parts.map(({ title, t, tall, lines, band }) => {
      const beneath = (chart) =>
        band && inside(chart, (ctx) => {
          ctx.globalAlpha = 0.28;
          ctx.fillStyle = palette.band;
          area(chart, t, band.low, band.high);
        });
      const options = {
        cursor: { show: false },
        scales: { x: { time: false } },
        axes: [timeAxis(palette), valueAxis(palette)],
        series: [{}, ...lines.map(({ colour, ...more }) => line(palette, colour, more))],
        hooks: { drawAxes: [beneath] },
      };
      return { ...named(title, options, [t, ...lines.map((each) => each.values)]), tall };
    });
    charts = made;
    root.replaceChildren(...made.flatMap((each) => each.parts));
    fit();
  }

  function fit() {
    if (!charts.length || !root.clientWidth) return;
    const total = charts.reduce((sum, each) => sum + (each.tall ? 2 : 1), 0);
    const free = Math.max(freeHeight(root), LEAST * charts.length);
    for (const { chart, tall } of charts) {
      chart.setSize({ width: root.clientWidth, height: Math.floor((free * (tall ? 2 : 1)) / total) });
    }
  }

  new ResizeObserver(fit).observe(root);
  return { show: build };
}
