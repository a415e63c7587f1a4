// What is painted onto the run's charts beneath and above their own lines, each from what is seen alone.

import { DASHES, otherColour } from "./colours.js";
import { base } from "./lanes.js";
import { area, curve, inside } from "./strokes.js";

/**
 * @typedef {object} Seen
 * @property {object} run reply to "look"
 * @property {object|null} band certified {t, low, high, fresh}; not fresh: of settings that have changed since
 * @property {{t: Float32Array, y: Float32Array[], colour: number, fresh: boolean}[]} others runs beside it
 * @property {object|null} thought reply to "costs"
 * @property {number} cursor its step
 * @property {Record<string, string>} palette
 */

const ratio = () => devicePixelRatio || 1;

/**
 * The certified band of an output.
 * @param {import("./charts.js").Chart} chart
 * @param {Seen} seen
 * @param {number} q
 */
export function beneath(chart, { band, palette }, q) {
  if (!band) return;
  inside(chart, (ctx) => {
    ctx.globalAlpha = band.fresh ? 0.28 : 0.09;
    ctx.fillStyle = palette.band;
    area(chart, band.t, band.low[q], band.high[q]);
  });
}

/**
 * The runs beside it, where the candidates would land, the cursor.
 * @param {import("./charts.js").Chart} chart
 * @param {Seen} seen
 * @param {number} q
 */
export function above(chart, seen, q) {
  inside(chart, (ctx) => {
    for (const { t, y, colour, fresh } of seen.others.filter((each) => each.y[q])) {
      ctx.strokeStyle = seen.palette[otherColour(colour)];
      ctx.setLineDash(DASHES[colour % 4].map((dash) => dash * ratio()));
      ctx.lineWidth = 1.5 * ratio();
      ctx.globalAlpha = fresh ? 1 : 0.4;
      curve(chart, t, y[q]);
    }
  });
  landings(chart, seen, q);
  cursorLine(chart, seen);
}

/**
 * The inputs' names on their lanes, the cursor.
 * @param {import("./charts.js").Chart} chart
 * @param {Seen} seen
 */
export function laneNames(chart, seen) {
  const { run, palette } = seen;
  if (run.inputs.length > 1) {
    inside(chart, (ctx) => {
      ctx.font = `${11 * ratio()}px system-ui, sans-serif`;
      ctx.textAlign = "left";
      ctx.textBaseline = "alphabetic";
      run.inputs.forEach((name, j) => {
        const y = chart.valToPos(base(run, j) + 1.1, "y", true);
        ctx.lineWidth = 3 * ratio();
        ctx.strokeStyle = palette.paper;
        ctx.strokeText(name, chart.bbox.left + 6 * ratio(), y);
        ctx.fillStyle = palette.ink;
        ctx.fillText(name, chart.bbox.left + 6 * ratio(), y);
      });
    });
  }
  cursorLine(chart, seen);
}

/** Where each candidate would take the output, with a line from where it is. */
function landings(chart, { run, thought, cursor, palette }, q) {
  if (!thought?.landing || thought.step !== cursor || !Number.isFinite(thought.landing_time)) return;
  const place = (t, y) => [chart.valToPos(t, "x", true), chart.valToPos(y, "y", true)];
  inside(chart, (ctx) => {
    const [x, y] = place(run.t[cursor], run.y[q][cursor]);
    ctx.strokeStyle = ctx.fillStyle = palette.landing;
    thought.landing.forEach((row, i) => {
      if (!Number.isFinite(row[q])) return;
      const [toX, toY] = place(thought.landing_time, row[q]);
      ctx.lineWidth = ratio();
      ctx.setLineDash([2 * ratio(), 3 * ratio()]);
      ctx.beginPath();
      ctx.moveTo(x, y);
      ctx.lineTo(toX, toY);
      ctx.stroke();
      ctx.setLineDash([]);
      ctx.lineWidth = 1.5 * ratio();
      ctx.beginPath();
      ctx.arc(toX, toY, 4 * ratio(), 0, 2 * Math.PI);
      if (i === thought.chosen) ctx.fill();
      else ctx.stroke();
    });
  });
}

function cursorLine(chart, { run, cursor, palette }) {
  const x = chart.valToPos(run.t[cursor], "x", true);
  inside(chart, (ctx) => {
    ctx.strokeStyle = palette.ink;
    ctx.lineWidth = ratio();
    ctx.globalAlpha = 0.7;
    ctx.beginPath();
    ctx.moveTo(x, chart.bbox.top);
    ctx.lineTo(x, chart.bbox.top + chart.bbox.height);
    ctx.stroke();
  });
}
