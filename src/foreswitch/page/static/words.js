// A run and its certificate in sentences and rows of figures.

import { show } from "./scale.js";
import { bare, unitOf } from "./sizes.js";

function time(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  return Math.abs(seconds) < 1 ? `${show(1000 * seconds)} ms` : `${show(seconds)} s`;
}
const capital = (text) => text[0].toUpperCase() + text.slice(1);
const withUnit = (value, name) => `${show(value)} ${unitOf(name)}`.trim();

/** Figures of one output or input may stand alone. */
const lists = (metrics) => Object.fromEntries(Object.entries(metrics).map(([name, value]) => [name, [value].flat()]));

/**
 * What the picture shows, for those who do not see it.
 * @param {object} run reply to "look"
 * @returns {string}
 */
export function summary(run) {
  const metrics = lists(run.metrics);
  const outputs = run.outputs.map((name, q) => {
    const lag = metrics.lag[q];
    const follows = `${bare(name)} follows its reference with an rms error of ${withUnit(metrics.rms_error[q], name)}`;
    if (Math.abs(lag) < 1e-9) return `${follows}, without lag`;
    const shift = lag > 0 ? `${time(lag)} behind` : `${time(-lag)} ahead`;
    return `${follows}, ${shift}; with that taken out, ${withUnit(metrics.rms_error_at_lag[q], name)} remain`;
  });
  const inputs = run.inputs.map((name, j) => `${bare(name)}: ${metrics.switches[j]} switches`);
  const odd = run.status.reduce((count, status) => count + (status !== 0), 0);
  const unsound = odd
    ? [`In ${odd} periods the command did not rest on a sound measurement; move the cursor there to read why`]
    : [];
  const more = [...unsound, ...(run.warnings ?? [])].map((each) => sentence(capital(each)));
  const switched = `${capital(inputs.join(", "))} in ${time(run.t.at(-1))}.`;
  return [`${capital(outputs.join("; "))}.`, switched, ...more].join(" ");
}

/**
 * What is proven, or why nothing is.
 * @param {object} proof reply to "certify"
 * @param {string[]} outputs
 * @returns {string}
 */
export function verdict(proof, outputs) {
  if (!proof.holds) return `Not proven: ${sentence(proof.reasons?.[0] ?? "")}`;
  const bounds = outputs.map((name, q) =>
    `${withUnit(proof.error_bound[q], name)}${outputs.length > 1 ? ` (${bare(name)})` : ""}`
  );
  const within = `at no time further than ${bounds.join(", ")} from the ideal response (the shaded band)`;
  if (proof.covers) return `Proven for the model alone: ${within}; ${sentence(proof.covers)}`;
  return `Proven: ${within}.`;
}

/**
 * With a full stop.
 * @param {string} text
 * @returns {string}
 */
export function sentence(text) {
  return /[.!?]$/.test(text) ? text : `${text}.`;
}

/** Heads of the table of runs. */
export const HEADS = [
  "run",
  "rms error",
  "lag",
  "rms error without it",
  "largest error",
  "switches",
  "time on",
  "proven bound",
];

/**
 * A row of that table.
 * @param {object} metrics of a run
 * @param {string[]} outputs
 * @param {object|null|undefined} proof null: none is made of such a law; undefined: not there yet
 * @returns {string[]}
 */
export function figures(metrics, outputs, proof) {
  const { rms_error, lag, rms_error_at_lag, max_error, switches, on_time } = lists(metrics);
  const inUnit = (values) => values.map((value, q) => withUnit(value, outputs[q])).join(", ");
  const times = (values) => values.map(time).join(", ");
  const bound = () => {
    if (!proof) return proof === null ? "" : "…";
    return proof.holds ? `${inUnit(proof.error_bound)}${proof.covers ? " (model only)" : ""}` : "none";
  };
  return [
    inUnit(rms_error),
    times(lag),
    inUnit(rms_error_at_lag),
    inUnit(max_error),
    switches.join(", "),
    times(on_time),
    bound(),
  ];
}

/**
 * A command's levels.
 * @param {Float32Array|number[]} levels
 * @param {string[]} inputs
 * @returns {string}
 */
export function command(levels, inputs) {
  return inputs.map((name, j) => `${bare(name)} ${show(levels[j])}`).join(", ");
}
