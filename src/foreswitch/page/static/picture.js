// The run: a chart for each output over its reference and certified band, and one with the commands as stairs.

import { freeHeight, line, named, timeAxis, valueAxis } from "./charts.js";
import { colours } from "./colours.js";
import { byId } from "./dom.js";
import { laneMarks, lanesRange, stairs } from "./lanes.js";
import { above, beneath, laneNames } from "./paint.js";
import { show } from "./scale.js";
import { extent } from "./strokes.js";

/** Nothing narrower is taken for a stretch of time drawn with the pointer [px]. */
const NARROW = 4;
/** Height of the commands [px], with no lane and for each; at most this share of all, at least so much. */
const COMMANDS = { foot: 34, lane: 44, share: 0.42, least: 64 };
/** All charts are at least so high together [px]. */
const LEAST = 120;

/**
 * @param {(step: number) => void} moved of the cursor
 * @returns {object} see the functions at its end
 */
export function picture(moved) {
  const root = byId("charts");
  const slider = byId("cursor");
  /** @type {import("./paint.js").Seen} */
  const seen = { run: null, band: null, others: [], thought: null, cursor: 0, palette: colours() };
  let charts = []; // those of the outputs, then that of the commands
  let shape = "";
  let stretch = null; // [from, to] looked at, null: all
  let calm = false; // while a slider is dragged scales grow but do not shrink
  const ranges = new Map(); // those last drawn, by output

  const span = () => stretch ?? [seen.run.t[0], seen.run.t.at(-1)];

  function outputRange(q) {
    const { run, band, others } = seen;
    const curves = [
      { t: run.t, y: run.y[q] },
      { t: run.t, y: run.r[q] },
      ...others.filter((each) => each.y[q]).map((each) => ({ t: each.t, y: each.y[q] })),
    ];
    if (band?.fresh) curves.push({ t: band.t, y: band.low[q] }, { t: band.t, y: band.high[q] });
    const [from, to] = span();
    let [low, high] = extent(curves, from, to);
    const before = ranges.get(q);
    if (calm && before) [low, high] = [Math.min(low, before[0]), Math.max(high, before[1])];
    ranges.set(q, [low, high]);
    return [low, high];
  }

  function options(series, axes, range, hooks) {
    return {
      cursor: {
        y: false,
        points: { show: false },
        drag: { x: true, y: false, setScale: false },
        sync: { key: "run", setSeries: false },
      },
      scales: { x: { time: false, range: () => span() }, y: { range } },
      axes,
      series: [{}, ...series],
      hooks: {
        ...hooks,
        setSelect: [selected],
        ready: [(chart) => chart.over.addEventListener("click", (event) => clicked(chart, event))],
      },
    };
  }

  function selected(chart) {
    const { left, width } = chart.select;
    if (width < NARROW) return;
    stretch = [chart.posToVal(left, "x"), chart.posToVal(left + width, "x")];
    chart.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    draw();
  }

  function clicked(chart, event) {
    const { run } = seen;
    const t = chart.posToVal(event.clientX - chart.over.getBoundingClientRect().left, "x");
    go(Math.round((t - run.t[0]) / run.Ts));
    slider.focus({ preventScroll: true });
  }

  function outputChart(name, q) {
    const { palette } = seen;
    const series = [line(palette, "reference", { dash: [6, 4] }), line(palette, "output", { width: 2 })];
    const unmarked = timeAxis(palette, { size: 4, values: (_chart, splits) => splits.map(() => "") });
    const hooks = { drawAxes: [(chart) => beneath(chart, seen, q)], draw: [(chart) => above(chart, seen, q)] };
    return named(name, options(series, [unmarked, valueAxis(palette)], () => outputRange(q), hooks), null);
  }

  function commandChart() {
    const { palette, run: { inputs } } = seen;
    const name = inputs.length > 1 ? "commands, as issued; time [s]" : `${inputs[0]}, as commanded; time [s]`;
    const series = inputs.map(() => line(palette, "command", { stairs: true }));
    const levels = valueAxis(palette, {
      splits: () => laneMarks(seen.run).map((mark) => mark.at),
      values: () => laneMarks(seen.run).map((mark) => mark.text),
    });
    const hooks = { draw: [(chart) => laneNames(chart, seen)] };
    return named(
      name,
      options(series, [timeAxis(palette), levels], () => lanesRange(seen.run), hooks),
      null,
      "commands",
    );
  }

  function build() {
    for (const chart of charts) chart.destroy();
    ranges.clear();
    const made = [...seen.run.outputs.map(outputChart), commandChart()];
    charts = made.map((each) => each.chart);
    root.replaceChildren(...made.flatMap((each) => each.parts));
    fit();
  }

  /** Heights: the commands take what their lanes need, the outputs share the rest. */
  function fit() {
    if (!charts.length) return;
    const { foot, lane, share, least } = COMMANDS;
    const free = Math.max(freeHeight(root), LEAST);
    const below = Math.min(foot + lane * seen.run.inputs.length, Math.max(share * free, least));
    const each = (free - below) / (charts.length - 1);
    charts.forEach((chart, i) =>
      chart.setSize({ width: root.clientWidth, height: Math.floor(i === charts.length - 1 ? below : each) })
    );
  }

  function draw() {
    const { run } = seen;
    if (!run) return;
    charts.forEach((chart, i) => {
      if (i < charts.length - 1) chart.setData([run.t, run.r[i], run.y[i]]);
      else chart.setData([run.t, ...run.inputs.map((_, j) => stairs(run, j))]);
    });
    byId("whole").disabled = !stretch;
  }

  function repaint() {
    for (const chart of charts) chart.redraw(false, false);
  }

  /** The cursor at a step of the run. */
  function place(step) {
    const { run } = seen;
    seen.cursor = Math.min(Math.max(step, 0), run.u[0].length - 1);
    slider.max = run.u[0].length - 1;
    slider.value = seen.cursor;
    const outputs = run.outputs.map((name, q) => `${name} ${show(run.y[q][seen.cursor], 4)}`);
    slider.setAttribute("aria-valuetext", `${show(run.t[seen.cursor], 5)} s: ${outputs.join(", ")}`);
  }

  function go(step) {
    if (!seen.run) return;
    place(step);
    repaint();
    moved(seen.cursor);
  }

  function zoom(factor) {
    const { run, cursor } = seen;
    const [from, to] = span();
    const whole = run.t.at(-1) - run.t[0];
    const width = Math.min(Math.max((to - from) * factor, 4 * run.Ts), whole);
    const middle = run.t[cursor];
    const start = Math.min(Math.max(middle - width / 2, run.t[0]), run.t.at(-1) - width);
    stretch = width >= whole ? null : [start, start + width];
    draw();
  }

  slider.addEventListener("input", () => go(Number(slider.value)));
  slider.addEventListener("change", () => go(Number(slider.value)));
  byId("closer").addEventListener("click", () => seen.run && zoom(0.5));
  byId("wider").addEventListener("click", () => seen.run && zoom(2));
  byId("whole").addEventListener("click", () => {
    stretch = null;
    draw();
  });
  new ResizeObserver(fit).observe(root);

  return {
    /** A run, with the cursor's step (null: a third of the way) and whether a slider is being dragged. */
    show(run, step, dragged) {
      if (run !== seen.run) seen.thought = null; // of the run before
      seen.run = run;
      calm = dragged;
      if (stretch && stretch[1] > run.t.at(-1)) stretch = null;
      const now = JSON.stringify([run.inputs, run.outputs, run.levels]);
      place(step ?? Math.floor(run.u[0].length / 3));
      if (now !== shape) {
        shape = now;
        seen.band = null; // of another plant
        build();
      }
      draw();
    },
    /** A certified band, or null; not fresh: of settings that have changed since. */
    band(next) {
      seen.band = next;
      draw();
    },
    /** The band is of earlier settings from now on. */
    dim() {
      if (seen.band) seen.band = { ...seen.band, fresh: false };
    },
    /** Whether a band is drawn. */
    banded: () => Boolean(seen.band),
    overlay(next) {
      seen.others = next;
      draw();
    },
    thought(next) {
      seen.thought = next;
      repaint();
    },
    /** The step at which the cursor stands. */
    step: () => seen.cursor,
    restyle() {
      seen.palette = colours();
      if (!seen.run) return;
      build();
      draw();
    },
  };
}
