// Curves drawn onto a chart beside its own series: they may have instants of their own.

/**
 * A curve, thinned to the extremes of each column of pixels.
 * @param {import("./charts.js").Chart} chart
 * @param {Float32Array} t
 * @param {Float32Array} y
 * @param {(context: CanvasRenderingContext2D) => void} [leave] what to do with the path; default: stroke it
 */
export function curve(chart, t, y, leave = (context) => context.stroke()) {
  const { ctx } = chart;
  ctx.beginPath();
  trail(chart, t, y, 0, t.length - 1);
  leave(ctx);
}

/**
 * The area between two curves.
 * @param {import("./charts.js").Chart} chart
 * @param {Float32Array} t
 * @param {Float32Array} low
 * @param {Float32Array} high
 */
export function area(chart, t, low, high) {
  const { ctx } = chart;
  ctx.beginPath();
  trail(chart, t, low, 0, t.length - 1);
  trail(chart, t, high, t.length - 1, 0);
  ctx.closePath();
  ctx.fill();
}

function trail(chart, t, y, from, to) {
  const { ctx } = chart;
  const step = Math.sign(to - from) || 1;
  let column = NaN;
  let least = 0;
  let most = 0;
  const flush = () => {
    if (!Number.isNaN(column)) {
      ctx.lineTo(column, least);
      if (most !== least) ctx.lineTo(column, most);
    }
  };
  for (let i = from; i !== to + step; i += step) {
    const x = chart.valToPos(t[i], "x", true);
    const place = chart.valToPos(y[i], "y", true);
    const rounded = Math.round(x * 2) / 2; // half a pixel of the device: finer is not seen
    if (rounded !== column) {
      flush();
      column = rounded;
      least = most = place;
    } else {
      least = Math.min(least, place);
      most = Math.max(most, place);
    }
  }
  flush();
}

/**
 * Draws within the plotting area of a chart only.
 * @param {import("./charts.js").Chart} chart
 * @param {(context: CanvasRenderingContext2D) => void} draw
 */
export function inside(chart, draw) {
  const { ctx, bbox } = chart;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  draw(ctx);
  ctx.restore();
}

/**
 * Least and largest of curves between two instants, with a margin.
 * @param {{t: Float32Array, y: Float32Array}[]} curves
 * @param {number} from
 * @param {number} to
 * @returns {[number, number]}
 */
export function extent(curves, from, to) {
  let low = Infinity;
  let high = -Infinity;
  for (const { t, y } of curves) {
    for (let i = 0; i < t.length; i++) {
      if (t[i] < from || t[i] > to || !Number.isFinite(y[i])) continue;
      if (y[i] < low) low = y[i];
      if (y[i] > high) high = y[i];
    }
  }
  if (low > high) return [0, 1];
  const margin = (high - low || Math.abs(high) || 1) * 0.05;
  return [low - margin, high + margin];
}
