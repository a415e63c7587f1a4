// A record and the model found of it: what its charts show, and what is told beside them.

import { readColumns } from "./columns.js";
import { swatch } from "./compare.js";
import { make, tableParts } from "./dom.js";
import { show } from "./scale.js";
import { sentence } from "./words.js";

/** Of measurements and commands, and of the model over them [px]. */
const WIDTH = { record: 1.2, model: 1.8 };

const measured = (values) => ({ values, colour: "reference", width: WIDTH.record });
const commanded = (values) => ({ values, colour: "command", width: WIDTH.record, stairs: true });
const modelled = (values) => ({ values, colour: "output", width: WIDTH.model });

/**
 * @param {{text: string, columns: any, picked: any, reply: any}} record reply: to "identify"; null: not there yet
 * @returns {import("./recordcharts.js").Part[]}
 */
export function recordParts({ text, columns, picked, reply }) {
  const [outputs, inputs] = [[picked.output].flat(), [picked.input].flat()];
  const table = reply ? [] : readColumns(text, columns.rows);
  const column = (name) => table[columns.columns.indexOf(name)];
  const { t, u, y } = reply ?? { t: column(picked.time), u: inputs.map(column), y: outputs.map(column) };
  return [
    ...outputs.map((title, q) => ({
      title,
      t,
      tall: true,
      lines: [measured(y[q]), ...(reply ? [modelled(reply.model[q])] : [])],
    })),
    ...inputs.map((name, j) => ({ title: `${name}; time [s]`, t, lines: [commanded(u[j])] })),
    ...(reply?.pulse_t ? pulseParts(reply, outputs) : []),
  ];
}

/** The averaged response to the pulses of a record. */
function pulseParts({ pulse_t, pulse_mean, pulse_spread, pulse_model, pulse }, outputs) {
  return pulse_mean.map((mean, q) => ({
    title: `${outputs[q]}, averaged over ${pulse.count} pulses; time since the command [s]`,
    t: pulse_t,
    tall: true,
    band: {
      low: mean.map((value, i) => value - pulse_spread[q][i]),
      high: mean.map((value, i) => value + pulse_spread[q][i]),
    },
    lines: [measured(mean), modelled(pulse_model[q])],
  }));
}

/**
 * How much of what was measured a model explains.
 * @param {any} fit
 * @returns {string}
 */
export const explained = (fit) => [fit.fit_percent].flat().map((each) => `${show(each, 4)} %`).join(", ");

/** A table that is scrolled where it is too wide. */
function scrolled(name, heads, rows, caption) {
  const around = { className: "scroll", tabIndex: 0, role: "region", "aria-label": name };
  return make("div", around, make("table", {}, ...tableParts(heads, rows, caption)));
}

/** The parameters with their standard errors. */
function parameters({ parameters }) {
  const rows = Object.entries(parameters).map(([name, { value, unit, standard_error }]) => [
    unit ? `${name} [${unit}]` : name,
    show(value, 5),
    `± ${show(standard_error, 2)}`,
  ]);
  return scrolled("Parameters", ["", "value", "standard error"], rows, "Parameters of the model");
}

function warnings({ warnings }) {
  if (!warnings.length) return [];
  const items = warnings.map((each) => make("li", {}, sentence(each)));
  return [make("h3", {}, "What to look out for"), make("ul", { className: "warnings" }, ...items)];
}

/** Other forms of the model beside the one chosen. */
function forms({ candidates }) {
  if (!candidates || candidates.length < 2) return [];
  const rows = candidates.map(({ structure, chosen, criterion, fit_percent }) => [
    `${structure}${chosen ? " (chosen)" : ""}`,
    show(criterion, 5),
    show(fit_percent, 4),
  ]);
  const caption = "Smaller criteria are better (Bayesian information criterion)";
  const table = scrolled("Forms compared", ["", "criterion", "fit [%]"], rows, caption);
  return [make("details", {}, make("summary", {}, "Forms compared"), table)];
}

/**
 * @param {any} reply to "identify"
 * @param {(found: any) => void} use
 * @returns {Node[]}
 */
export function foundModel(reply, use) {
  const { fit } = reply;
  const share = `The model explains ${explained(fit)} of what was measured. `;
  const button = make("button", { type: "button", className: "main" }, "Use this model");
  button.addEventListener("click", () => use(reply));
  return [
    make("h3", {}, `Found: ${[fit.structure].flat().join(", ")}`),
    make("p", {}, share, swatch("reference"), " measured ", swatch("output"), " model"),
    parameters(fit),
    ...warnings(fit),
    ...forms(fit),
    button,
  ];
}
