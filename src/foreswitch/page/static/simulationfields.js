// What can be set of a simulation: the reference, what the model does not know, and the run.

import { convertReference } from "./convert.js";
import { choice, each, number, numbers, place, positive, signed, upTo } from "./fieldkinds.js";
import { get, put } from "./paths.js";
import { even } from "./scale.js";
import { reach, references, unitOf } from "./sizes.js";

/** @type {[string, string][]} */
const KINDS = [
  ["constant", "constant"],
  ["half_sine", "half a sinusoid"],
  ["sine", "sinusoid"],
  ["ramp", "ramp"],
  ["steps", "steps"],
  ["points", "points"],
];
/** What each kind has of its own. */
const USES = {
  constant: ["value"],
  half_sine: ["height", "duration", "start", "offset"],
  sine: ["amplitude", "frequency", "phase", "offset"],
  ramp: ["slope", "start", "offset"],
  steps: ["times", "values"],
  points: ["times", "values", "between"],
};
/** @type {[string, string][]} */
const BETWEEN = [["pchip", "a smooth curve"], ["linear", "straight lines"], ["hold", "held"]];

export function referenceFields(table, path, name) {
  const y = unitOf(name);
  const far = reach(table);
  const parts = {
    value: number(`${path}.value`, "Value", signed(far), { unit: y }),
    height: number(`${path}.height`, "Rise", positive, { unit: y }),
    duration: number(`${path}.duration`, "Length", positive, { unit: "s" }),
    amplitude: number(`${path}.amplitude`, "Amplitude", positive, { unit: y }),
    frequency: number(`${path}.frequency`, "Frequency", positive, { unit: "Hz" }),
    phase: number(`${path}.phase`, "Phase", () => even(-3.15, 3.15, 0.01), { unit: "rad", idle: 0 }),
    slope: number(`${path}.slope`, "Slope", positive, { unit: y ? `${y}/s` : "1/s" }),
    start: number(`${path}.start`, "Begins at", upTo(1), { unit: "s", idle: 0 }),
    offset: number(`${path}.offset`, "Added to all values", signed(far), { unit: y, idle: 0 }),
    times: numbers(`${path}.times`, "Times", { unit: "s" }),
    values: numbers(`${path}.values`, "Values", { unit: y }),
    between: choice(`${path}.between`, "Between them", BETWEEN, "pchip"),
  };
  const become = (state, kind) => put(state, place(path), convertReference(get(state, place(path)), kind));
  const kind = choice(`${path}.kind`, "Kind", KINDS, "constant", become);
  return [kind, ...(USES[table.kind] ?? []).map((key) => parts[key])];
}

export function truthFields(state, { states, inputs, outputs }) {
  const { project } = state;
  const Ts = project.actuator?.Ts ?? 1e-3;
  const estimated = project.estimator !== undefined;
  const stateNames = states === 1 ? [outputs[0]] : Array.from({ length: states }, (_, i) => `state ${i + 1}`);
  const measured = estimated ? outputs : stateNames;
  const far = Math.max(...references(project).map(reach));
  const longest = Math.max(0, ...[project.plant?.input_delay ?? 0].flat());
  const noise = { unit: (i) => (estimated || i === 0 ? unitOf(outputs[i]) : ""), idle: 0 };
  const load = { unit: (i) => unitOf(inputs[i]), idle: 0 };
  const seconds = { unit: () => "s", idle: 0, together: true };
  const quantum = { idle: 0, together: true };
  const { disturbance } = project.simulation ?? {};
  const steady = [number("simulation.disturbance", "Measured disturbance", signed(1))];
  const vent = [
    number("simulation.disturbance.gain", "Vent, opening per error", positive),
    number("simulation.disturbance.high", "Vent, largest flow", positive),
  ];
  return [
    number("options.delay_error", "Dead time wrong by", signed(Math.max(longest, Ts)), { unit: "s", idle: 0 }),
    number("options.gain_error", "Gain wrong by", () => even(-0.5, 0.5, 0.01), { unit: "share", idle: 0 }),
    ...each(state, "simulation.noise", "Noise", measured, upTo(0.02 * far), noise),
    ...each(state, "simulation.load", "Unmeasured load", inputs, signed(0.5), load),
    ...each(state, "simulation.hardware.opening", "Travel time, opening", inputs, upTo(5 * Ts), seconds),
    ...each(state, "simulation.hardware.closing", "Travel time, closing", inputs, upTo(5 * Ts), seconds),
    ...each(state, "simulation.hardware.quantum", "Step of the sensor", ["all"], upTo(0.02 * far), quantum),
    ...(typeof disturbance === "number" ? steady : disturbance?.high === undefined ? [] : vent),
  ];
}

export function runFields() {
  return [
    number("simulation.duration", "Length of the run", positive, { unit: "s" }),
    numbers("simulation.x0", "State at the start", { optional: true }),
    number("simulation.seed", "Seed of the noise", () => even(0, 100, 1), { whole: true }),
  ];
}
