// The run in words and figures, and what stands beside it: legend, table, overlays. Each is made from the store alone.

import { drawn } from "./beside.js";
import { DASHES, otherColour } from "./colours.js";
import { swatch } from "./compare.js";
import { byId, make, tableParts } from "./dom.js";
import { figures, HEADS, summary, verdict } from "./words.js";

/**
 * @param {import("./store.js").Store} store
 * @param {object} drawing see picture.js
 * @param {{show: Function}} comparing
 */
export function readout(store, drawing, comparing) {
  function legend() {
    const { proof } = store.now();
    const item = (mark, text) => make("li", {}, mark, text);
    const band = !proof ? ", of the settings before" : proof.covers ? ", of the model alone" : "";
    byId("legend").replaceChildren(
      item(swatch("output"), "output"),
      item(swatch("reference", [6, 4]), "reference"),
      ...(drawing.banded() ? [item(make("span", { className: "swatch area" }), `proven band${band}`)] : []),
      ...drawn(store.now())
        .filter((each) => each.run)
        .map((each) => item(swatch(otherColour(each.colour), DASHES[each.colour % 4]), each.label)),
    );
  }

  function table() {
    const { last: { run }, proof } = store.now();
    if (!run) return;
    const rows = drawn(store.now())
      .filter((each) => each.run)
      .map(({ label, run, law, proof }) => [label, ...figures(run.metrics, run.outputs, law ? null : proof)]);
    const caption = "Figures of merit; several outputs or inputs in their order";
    const present = ["this run", ...figures(run.metrics, run.outputs, proof)];
    byId("figures").replaceChildren(...tableParts(HEADS, [present, ...rows], caption));
  }

  function overlays() {
    const { settings, last } = store.now();
    const there = drawn(store.now());
    const alike = (each) => each.run && last.run && String(each.run.outputs) === String(last.run.outputs);
    drawing.overlay(
      there.filter(alike).map(({ run, colour, waiting }) => ({ t: run.t, y: run.y, colour, fresh: !waiting })),
    );
    const told = ({ waiting = false, error = undefined, run = undefined }) =>
      waiting ? {} : { error, parameters: run?.parameters, outputs: run?.outputs };
    const laws = there.filter((each) => each.law).map((each) => [each.place, told(each)]);
    comparing.show(settings.view, Object.fromEntries(laws));
    legend();
    table();
  }

  return {
    legend,
    table,
    overlays,
    /** The run, once it is in the picture. */
    run() {
      byId("summary").textContent = summary(store.now().last.run);
      table();
    },
    /** A proof is being looked for. */
    looking() {
      byId("proof").textContent = "Looking for a proof …";
    },
    /** What was found of it. */
    proof() {
      const { last: { run }, proof } = store.now();
      byId("proof").textContent = run && proof ? verdict(proof, run.outputs) : "";
      legend();
      table();
    },
  };
}
