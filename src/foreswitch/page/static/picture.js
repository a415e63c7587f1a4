// The run: a chart for each output over its reference and certified band, and one with the commands as stairs.

import { byId, make } from "./dom.js";
import { axisFont, colours, DASHES, otherColour } from "./colours.js";
import { show } from "./scale.js";
import { area, curve, inside } from "./strokes.js";

const AXIS = 62; // width of the axes at the left [px]: that of "-1000000"
const LANE = 1.6; // distance of one input's stairs from the next, in their height

const ratio = () => devicePixelRatio || 1;

/** Least and largest of curves between two instants. */
function extent(curves, from, to) {
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

/**
 * @param {(step: number, done: boolean) => void} moved of the cursor
 * @returns {object} see the functions at its end
 */
export function picture(moved) {
  const root = byId("charts");
  const slider = byId("cursor");
  let palette = colours();
  let charts = []; // those of the outputs, then that of the commands
  let shape = "";
  let run = null; // the last reply to "look"
  let proof = null; // {t, ideal, low, high, fresh}
  let others = []; // [{label, t, y, colour}]
  let thought = null; // the last reply to "costs"
  let cursor = 0;
  let stretch = null; // [from, to] looked at, null: all
  let calm = false; // while a slider is dragged scales grow but do not shrink
  const ranges = new Map();

  const span = () => stretch ?? [run.t[0], run.t.at(-1)];

  function outputRange(q) {
    const [from, to] = span();
    const curves = [
      { t: run.t, y: run.y[q] },
      { t: run.t, y: run.r[q] },
      ...others.filter((each) => each.y[q]).map((each) => ({ t: each.t, y: each.y[q] })),
    ];
    if (proof?.fresh) curves.push({ t: proof.t, y: proof.low[q] }, { t: proof.t, y: proof.high[q] });
    let [low, high] = extent(curves, from, to);
    const before = ranges.get(q);
    if (calm && before) [low, high] = [Math.min(low, before[0]), Math.max(high, before[1])];
    ranges.set(q, [low, high]);
    return [low, high];
  }

  function cursorLine(chart) {
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

  function beneath(chart, q) {
    if (!proof) return;
    inside(chart, (ctx) => {
      ctx.globalAlpha = proof.fresh ? 0.28 : 0.09;
      ctx.fillStyle = palette.band;
      area(chart, proof.t, proof.low[q], proof.high[q]);
    });
  }

  function above(chart, q) {
    inside(chart, (ctx) => {
      others.forEach((each) => {
        if (!each.y[q]) return;
        ctx.strokeStyle = palette[otherColour(each.colour)];
        ctx.setLineDash(DASHES[each.colour % 4].map((dash) => dash * ratio()));
        ctx.lineWidth = 1.5 * ratio();
        ctx.globalAlpha = each.fresh ? 1 : 0.4;
        curve(chart, each.t, each.y[q]);
      });
    });
    if (thought?.landing && thought.step === cursor && Number.isFinite(thought.landing_time)) landings(chart, q);
    cursorLine(chart);
  }

  /** Where each candidate would take the output, with a line from where it is. */
  function landings(chart, q) {
    const place = (t, y) => [chart.valToPos(t, "x", true), chart.valToPos(y, "y", true)];
    inside(chart, (ctx) => {
      const from = place(run.t[cursor], run.y[q][cursor]);
      ctx.strokeStyle = ctx.fillStyle = palette.landing;
      thought.landing.forEach((row, i) => {
        if (!Number.isFinite(row[q])) return;
        const to = place(thought.landing_time, row[q]);
        ctx.lineWidth = ratio();
        ctx.setLineDash([2 * ratio(), 3 * ratio()]);
        ctx.beginPath();
        ctx.moveTo(...from);
        ctx.lineTo(...to);
        ctx.stroke();
        ctx.setLineDash([]);
        ctx.lineWidth = 1.5 * ratio();
        ctx.beginPath();
        ctx.arc(...to, 4 * ratio(), 0, 2 * Math.PI);
        if (i === thought.chosen) ctx.fill();
        else ctx.stroke();
      });
    });
  }

  function laneNames(chart) {
    if (run.inputs.length > 1) {
      inside(chart, (ctx) => {
        ctx.font = `${11 * ratio()}px system-ui, sans-serif`;
        ctx.textAlign = "left";
        ctx.textBaseline = "alphabetic";
        run.inputs.forEach((name, j) => {
          const y = chart.valToPos(base(j) + 1.1, "y", true);
          ctx.lineWidth = 3 * ratio();
          ctx.strokeStyle = palette.paper;
          ctx.strokeText(name, chart.bbox.left + 6 * ratio(), y);
          ctx.fillStyle = palette.ink;
          ctx.fillText(name, chart.bbox.left + 6 * ratio(), y);
        });
      });
    }
    cursorLine(chart);
  }

  const base = (j) => (run.inputs.length - 1 - j) * LANE;
  const ends = (j) => [run.levels[j][0], run.levels[j].at(-1)];

  /** An input's levels between 0 and 1, on its lane. */
  function lane(j) {
    const [low, high] = ends(j);
    const height = high - low || 1;
    return (level) => base(j) + (level - low) / height;
  }

  function laneMarks() {
    return run.levels.flatMap((levels, j) =>
      (levels.length <= 3 ? levels : ends(j)).map((level) => ({ at: lane(j)(level), text: show(level) }))
    )
      .sort((a, b) => a.at - b.at);
  }

  const axis = (more) => ({
    stroke: palette.soft,
    grid: { stroke: palette.grid, width: 1 },
    ticks: { stroke: palette.grid, width: 1, size: 4 },
    font: axisFont(),
    ...more,
  });

  function options(series, yAxis, scale, last, hooks) {
    return {
      width: 100,
      height: 60,
      pxAlign: 1,
      padding: [6, 12, 0, 0],
      legend: { show: false },
      cursor: {
        y: false,
        points: { show: false },
        drag: { x: true, y: false, setScale: false },
        sync: { key: "run", setSeries: false },
      },
      select: { show: true },
      scales: { x: { time: false, range: () => span() }, y: { range: scale } },
      axes: [
        axis(
          last
            ? { size: 30, values: (chart, splits) => splits.map((each) => show(each, 6)) }
            : { size: 4, values: (chart, splits) => splits.map(() => "") },
        ),
        axis({ size: AXIS, ...yAxis }),
      ],
      series: [{}, ...series],
      hooks: {
        ...hooks,
        setSelect: [(chart) => selected(chart)],
        ready: [(chart) => chart.over.addEventListener("click", (event) => clicked(chart, event))],
      },
    };
  }

  function selected(chart) {
    const { left, width } = chart.select;
    if (width < 4) return;
    stretch = [chart.posToVal(left, "x"), chart.posToVal(left + width, "x")];
    chart.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    draw();
  }

  function clicked(chart, event) {
    const t = chart.posToVal(event.clientX - chart.over.getBoundingClientRect().left, "x");
    go(Math.round((t - run.t[0]) / run.Ts), true);
    slider.focus({ preventScroll: true });
  }

  function build() {
    for (const { chart } of charts) chart.destroy();
    ranges.clear();
    const line = (colour, width, more = {}) => ({ stroke: palette[colour], width, points: { show: false }, ...more });
    const boxes = [];
    charts = run.outputs.map((name, q) => {
      const box = make("div", { className: "chart" });
      boxes.push(make("p", { className: "chart-name" }, name), box);
      const series = [line("reference", 1.5, { dash: [6, 4] }), line("output", 2)];
      const hooks = { drawAxes: [(chart) => beneath(chart, q)], draw: [(chart) => above(chart, q)] };
      const yAxis = { values: (chart, splits) => splits.map((each) => show(each, 6)) };
      return { box, chart: new uPlot(options(series, yAxis, () => outputRange(q), false, hooks), null, box) };
    });
    const box = make("div", { className: "chart commands" });
    const names = run.inputs;
    boxes.push(
      make(
        "p",
        { className: "chart-name" },
        names.length > 1 ? "commands, as issued; time [s]" : `${names[0]}, as commanded; time [s]`,
      ),
      box,
    );
    const stairs = names.map(() => line("command", 1.5, { paths: uPlot.paths.stepped({ align: 1 }) }));
    const yAxis = {
      splits: () => laneMarks().map((mark) => mark.at),
      values: () => laneMarks().map((mark) => mark.text),
    };
    const range = () => [-0.15, (names.length - 1) * LANE + (names.length > 1 ? 1.55 : 1.15)];
    charts.push({ box, chart: new uPlot(options(stairs, yAxis, range, true, { draw: [laneNames] }), null, box) });
    root.replaceChildren(...boxes);
    fit();
  }

  /** Heights: the commands take what their lanes need, the outputs share the rest. */
  function fit() {
    if (!charts.length) return;
    const width = root.clientWidth;
    const names = [...root.querySelectorAll(".chart-name")].reduce((sum, each) => sum + each.offsetHeight, 0);
    const lanes = run.inputs.length;
    const free = Math.max(root.clientHeight - names, 120);
    const below = Math.min(34 + 44 * lanes, Math.max(0.42 * free, 64));
    const each = (free - below) / (charts.length - 1);
    charts.forEach(({ chart }, i) =>
      chart.setSize({ width, height: Math.floor(i === charts.length - 1 ? below : each) })
    );
  }

  function draw() {
    if (!run) return;
    const q = charts.length - 1;
    charts.forEach(({ chart }, i) => {
      if (i < q) chart.setData([run.t, run.r[i], run.y[i]]);
      else chart.setData([run.t, ...run.u.map((row, j) => stairs(row, lane(j)))]);
    });
    byId("whole").disabled = !stretch;
  }

  function stairs(row, level) {
    const values = new Float32Array(row.length + 1);
    for (let k = 0; k < row.length; k++) values[k] = level(row[k]);
    values[row.length] = values[row.length - 1]; // the last command holds to the end
    return values;
  }

  function repaint() {
    for (const { chart } of charts) chart.redraw(false, false);
  }

  function valueText() {
    const outputs = run.outputs.map((name, q) => `${name} ${show(run.y[q][cursor], 4)}`);
    slider.setAttribute("aria-valuetext", `${show(run.t[cursor], 5)} s: ${outputs.join(", ")}`);
  }

  function go(step, done) {
    if (!run) return;
    cursor = Math.min(Math.max(step, 0), run.u[0].length - 1);
    slider.value = cursor;
    valueText();
    repaint();
    moved(cursor, done);
  }

  function zoom(factor) {
    const [from, to] = span();
    const whole = run.t.at(-1) - run.t[0];
    const width = Math.min(Math.max((to - from) * factor, 4 * run.Ts), whole);
    const middle = run.t[cursor];
    const start = Math.min(Math.max(middle - width / 2, run.t[0]), run.t.at(-1) - width);
    stretch = width >= whole ? null : [start, start + width];
    draw();
  }

  function restyle() {
    palette = colours();
    if (!run) return;
    build();
    draw();
  }

  slider.addEventListener("input", () => go(Number(slider.value), false));
  slider.addEventListener("change", () => go(Number(slider.value), true));
  byId("closer").addEventListener("click", () => run && zoom(0.5));
  byId("wider").addEventListener("click", () => run && zoom(2));
  byId("whole").addEventListener("click", () => {
    stretch = null;
    draw();
  });
  new ResizeObserver(fit).observe(root);

  return {
    /** A run, with the cursor's step (null: a third of the way) and whether a slider is being dragged. */
    show(reply, step, dragged) {
      if (reply !== run) thought = null; // of the run before
      run = reply;
      calm = dragged;
      if (stretch && stretch[1] > run.t.at(-1)) stretch = null;
      cursor = Math.min(step ?? Math.floor(run.u[0].length / 3), run.u[0].length - 1);
      slider.max = run.u[0].length - 1;
      slider.value = cursor;
      const now = JSON.stringify([run.inputs, run.outputs, run.levels]);
      if (now !== shape) {
        shape = now;
        proof = null; // of another plant
        build();
      }
      draw();
      valueText();
    },
    /** A certified band, or null; not fresh: of settings that have changed since. */
    band(next) {
      proof = next;
      draw();
    },
    /** The band is of earlier settings from now on. */
    dim() {
      if (proof) proof = { ...proof, fresh: false };
    },
    /** Whether a band is drawn. */
    banded: () => Boolean(proof),
    overlay(next) {
      others = next;
      draw();
    },
    thought(next) {
      thought = next;
      repaint();
    },
    /** The step at which the cursor stands. */
    step: () => cursor,
    restyle,
  };
}
