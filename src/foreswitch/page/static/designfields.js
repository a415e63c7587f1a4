// What can be set of a design: plant, actuator, controller and estimator.

import { convertObjective, convertPlant } from "./convert.js";
import { choice, count, each, number, numbers, positive, signed, upTo } from "./fieldkinds.js";
import { put, putAll } from "./paths.js";
import { decades, even } from "./scale.js";
import { reach, references, unitOf } from "./sizes.js";

/** @typedef {[string, string][]} Words value and words */

/** @type {Words} */
const MODELS = [
  ["integrator_lag", "integrator and lag"],
  ["fopdt", "gain and one lag"],
  ["transfer_function", "transfer function"],
  ["state_space", "state space"],
];
/** @type {Words} */
const OBJECTIVES = [["endpoint", "where the output lands"], ["horizon", "the way over many periods"]];
/** The last one is of a horizon alone. @type {Words} */
const TAILS = [["rest", "what holds the reference"], ["zero", "zero"], ["hold", "the last move"]];
/** @type {Words} */
const TERMINALS = [["none", "none"], ["riccati", "of ending away from rest"]];
/** @type {Words} */
const REALS = [["float64", "double precision"], ["float32", "single precision"]];

/** A power of s. */
function power(n) {
  if (n < 2) return n === 0 ? "constant" : "s";
  return `s${[...String(n)].map((digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit]).join("")}`;
}

export function plantFields(state, names) {
  const { project } = state;
  const { plant } = project;
  const y = unitOf(names.outputs[0]);
  const Ts = project.actuator?.Ts ?? 1e-3;
  const become = (s, value) => ({ ...s, project: convertPlant(s.project, value) });
  const model = choice("plant.model", "Form", MODELS, "integrator_lag", become);
  const perSecond = y ? `${y}/s` : "1/s";
  const own = {
    integrator_lag: [
      number("plant.k", "Slope at full input", positive, { unit: perSecond }),
      number("plant.c", "Lag", positive, { unit: "s" }),
    ],
    fopdt: [
      number("plant.K", "Gain", positive, { unit: y }),
      number("plant.T", "Time constant", positive, { unit: "s" }),
    ],
    transfer_function: [
      ...(plant.num ?? []).map((_, i) =>
        number(`plant.num.${i}`, `Numerator, ${power(plant.num.length - 1 - i)}`, positive)
      ),
      ...(plant.den ?? []).map((_, i) =>
        number(`plant.den.${i}`, `Denominator, ${power(plant.den.length - 1 - i)}`, positive)
      ),
    ],
    state_space: [numbers("plant.A", "State matrix A", { unit: "1/s" }), numbers("plant.B", "Input matrix B")],
  };
  const delay = each(state, "plant.input_delay", "Dead time", names.inputs, upTo(20 * Ts), {
    unit: () => "s",
    idle: 0,
  });
  return [model, ...(own[plant.model] ?? []), ...delay];
}

/** Entries of A and B that are not zero, with sliders. */
export function entryFields(state) {
  const { plant = {} } = state.project;
  if (plant.model !== "state_space") return [];
  const entry = (name, i, j) => number(`plant.${name}.${i}.${j}`, `${name}, row ${i + 1}, column ${j + 1}`, positive);
  const entries = (name) =>
    (plant[name] ?? []).flatMap((row, i) => [row].flat().flatMap((value, j) => (value ? [entry(name, i, j)] : [])));
  return [...entries("A"), ...entries("B")];
}

export function operatingFields(state, { inputs, outputs }) {
  const ofInput = { unit: (i) => unitOf(inputs[i]), idle: 0 };
  const ofOutput = { unit: (i) => unitOf(outputs[i]), idle: 0 };
  return [
    ...each(state, "plant.u_offset", "Input counts from", inputs, signed(1), ofInput),
    ...each(state, "plant.y_offset", "Output counts from", outputs, signed(1), ofOutput),
    numbers("plant.C", "Output matrix C", { optional: true }),
    numbers("plant.E", "Entry of a measured disturbance, E", { optional: true }),
  ];
}

export function actuatorFields(state, { inputs }) {
  const { project } = state;
  const { actuator = {} } = project;
  const Ts = actuator.Ts ?? 1e-3;
  const square = Math.max(...references(project).map(reach)) ** 2;
  const seconds = { unit: () => "s", idle: 0, together: true };
  const price = { idle: 0, together: true };
  return [
    numbers("actuator.levels", "Levels"),
    number("actuator.Ts", "Switching period", positive, { unit: "s" }),
    ...each(state, "actuator.min_on", "Shortest time on", inputs, upTo(10 * Ts), seconds),
    ...each(state, "actuator.min_off", "Shortest time off", inputs, upTo(10 * Ts), seconds),
    ...each(state, "actuator.switch_cost", "Price of a switching", inputs, upTo(1e-5 * square), price),
    ...(inputs.length > 1 ? [numbers("actuator.forbidden", "Forbidden combinations", { optional: true })] : []),
  ];
}

export function controllerFields(state, { outputs }) {
  const { project } = state;
  const { controller = {} } = project;
  const Ts = project.actuator?.Ts ?? 1e-3;
  const endpoint = (controller.objective ?? "endpoint") === "endpoint";
  const rate = { unit: () => "rad/s", together: true };
  const bandwidth = each(state, "controller.lam", "Bandwidth", outputs, positive, rate);
  const weight = each(state, "controller.weight", "Weight", outputs, positive, { idle: 1, together: true });
  const become = (s, value) => ({ ...s, project: convertObjective(s.project, value) });
  const objective = choice("controller.objective", "Look at", OBJECTIVES, "endpoint", become);
  const tails = endpoint ? TAILS.slice(0, 2) : TAILS;
  const tail = choice("controller.tail", "Input afterwards", tails, endpoint ? "rest" : "hold");
  const steps = controller.steps ?? 20;
  return [
    objective,
    ...(endpoint ? [number("controller.Td", "Settling horizon", positive, { unit: "s" })] : [
      number("controller.steps", "Periods looked at", count(64), { whole: true }),
      number("controller.moves", "Periods with free commands", count(steps), { whole: true, idle: steps }),
      number("controller.move_weight", "Price of a move", upTo(1), { idle: 0 }),
      numbers("controller.window", "First and last period weighed", { optional: true }),
    ]),
    ...(endpoint || controller.lam !== undefined ? bandwidth : []),
    ...weight,
    tail,
    ...(endpoint ? [] : [
      choice("controller.terminal", "Price of the end", TERMINALS, "none"),
      number("controller.node_budget", "Sequences tried at most", (value) => decades(value || 1000), { whole: true }),
    ]),
    previewField(endpoint),
    ...(typeof controller.preview === "number"
      ? [{
        ...number("controller.preview", "Seconds ahead", upTo(20 * Ts), { unit: "s" }),
        key: "controller.preview.seconds",
      }]
      : []),
    choice("controller.real", "Arithmetic", REALS, "float64"),
  ];
}

function previewField(endpoint) {
  const words = [
    ["false", "now"],
    ["true", "when the output lands"],
    ...(endpoint ? [["lag", "one lag ahead"]] : []),
    ["seconds", "seconds ahead"],
  ];
  const stored = { true: true, lag: "lag", seconds: 0 };
  return {
    path: "controller.preview",
    label: "Reference taken",
    kind: "choice",
    choices: words,
    read: (state) => {
      const held = state.project.controller?.preview ?? false;
      return typeof held === "number" ? "seconds" : String(held);
    },
    write: (state, value) => put(state, "project.controller.preview", stored[value]),
  };
}

export function estimatorFields(state, { outputs }) {
  const far = Math.max(...references(state.project).map(reach));
  const { estimator } = state.project;
  const start = { process_noise: 1e-6 * far ** 2, measurement_noise: 1e-6 * far ** 2 };
  const tick = {
    path: "estimator",
    label: "Estimate the state from the outputs",
    kind: "tick",
    read: (s) => s.project.estimator !== undefined,
    // a noise per state is none per output
    write: (s, on) => putAll(s, { "project.estimator": on ? start : undefined, "project.simulation.noise": undefined }),
  };
  if (!estimator) return [tick];
  const simple = (key) => typeof estimator[key] === "number";
  const variance = (key, label, unit) =>
    simple(key) ? number(`estimator.${key}`, label, positive, { unit }) : numbers(`estimator.${key}`, label, { unit });
  const y = unitOf(outputs[0]);
  return [
    tick,
    variance("process_noise", "Process noise, variance", ""),
    variance("measurement_noise", "Measurement noise, variance", y ? `${y}²` : ""),
    number("estimator.load", "Drift of an unknown load, variance", upTo(1e-4)),
    number("estimator.gate", "Outliers beyond", () => even(0, 12, 0.5), { unit: "deviations", idle: 6 }),
    number("estimator.gate_limit", "Outliers in a row left out", count(20), { whole: true, idle: 3 }),
  ];
}
