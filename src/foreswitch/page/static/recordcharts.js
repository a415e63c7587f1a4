// A record with the fit over it, and the averaged response to its pulses.

import { make } from "./dom.js";
import { axisFont, colours } from "./colours.js";
import { show } from "./scale.js";
import { area, inside } from "./strokes.js";

/**
 * @param {HTMLElement} root
 * @returns {{show: (shown: object|null) => void}} shown: title, t, lines [{name, values, colour, dash, width, stairs}], band {low, high}; each its own chart
 */
export function recordCharts(root) {
  let charts = [];
  let parts = [];

  function build() {
    for (const { chart } of charts) chart.destroy();
    const palette = colours();
    const axis = {
      stroke: palette.soft,
      grid: { stroke: palette.grid, width: 1 },
      ticks: { stroke: palette.grid, width: 1, size: 4 },
      font: axisFont(),
      values: (chart, splits) => splits.map((each) => show(each, 6)),
    };
    const boxes = [];
    charts = parts.map((part) => {
      const box = make("div", { className: "chart" });
      boxes.push(make("p", { className: "chart-name" }, part.title), box);
      const series = part.lines.map((line) => ({
        stroke: palette[line.colour],
        width: line.width ?? 1.5,
        dash: line.dash,
        points: { show: false },
        ...(line.stairs ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}),
      }));
      const beneath = (chart) =>
        part.band && inside(chart, (ctx) => {
          ctx.globalAlpha = 0.28;
          ctx.fillStyle = palette.band;
          area(chart, part.t, part.band.low, part.band.high);
        });
      const options = {
        width: 100,
        height: 60,
        padding: [6, 12, 0, 0],
        legend: { show: false },
        cursor: { show: false },
        scales: { x: { time: false } },
        axes: [{ ...axis, size: 30 }, { ...axis, size: 62 }],
        series: [{}, ...series],
        hooks: { drawAxes: [beneath] },
      };
      return { chart: new uPlot(options, [part.t, ...part.lines.map((line) => line.values)], box), tall: part.tall };
    });
    root.replaceChildren(...boxes);
    fit();
  }

  function fit() {
    if (!charts.length || !root.clientWidth) return;
    const names = [...root.querySelectorAll(".chart-name")].reduce((sum, each) => sum + each.offsetHeight, 0);
    const total = charts.reduce((sum, each) => sum + (each.tall ? 2 : 1), 0);
    const free = Math.max(root.clientHeight - names, 90 * charts.length);
    for (const { chart, tall } of charts) {
      chart.setSize({ width: root.clientWidth, height: Math.floor((free * (tall ? 2 : 1)) / total) });
    }
  }

  new ResizeObserver(fit).observe(root);
  return {
    show(next) {
      parts = next;
      build();
    },
  };
}
