// What can be set, in groups, for the project at hand. A field reads its value from the state and writes a changed state;
// it knows nothing of the page. Descriptions come with the server's schema.

import { get, put, putAll } from "./paths.js";
import { decades, even, fromZero, roundUp } from "./scale.js";
import { bare, reach, references, sizes, unitOf } from "./sizes.js";
import { convertObjective, convertPlant, convertReference } from "./convert.js";

const ERRORS = {
  delay_error: "how much longer the true dead time is than the model's; negative: shorter",
  gain_error: "how much larger the true gain is than the model's, as a share",
};

/** @param {string} path as the server names it: of the project, or beginning with "options" */
const place = (path) => (path.startsWith("options.") ? path : `project.${path}`);

/**
 * @typedef {object} Field
 * @property {string} path as the server names it in complaints
 * @property {string} [key] of its own, where two fields are of one path
 * @property {string} label
 * @property {"number"|"choice"|"text"|"tick"} kind
 * @property {string} [unit]
 * @property {(state: object) => any} read
 * @property {(state: object, value: any) => object} write
 * @property {(value: number) => object} [scale] of the slider, made for a value
 * @property {boolean} [whole] whole numbers only
 * @property {[string, string][]} [choices] value and words
 */

/** A number under a key of its own; equal to `idle`, the key is left out. */
function number(path, label, scale, { unit = "", idle, whole = false } = {}) {
  return {
    path,
    label,
    kind: "number",
    unit,
    scale,
    whole,
    read: (state) => get(state, place(path)) ?? idle,
    write: (state, value) => put(state, place(path), value === idle ? undefined : value),
  };
}

/** Numbers of which the file holds one for all or a list: one field for each name. */
function each(path, label, names, scale, { unit = () => "", idle, together = false } = {}) {
  const held = (state) => get(state, place(path));
  return (state) => {
    if (names.length === 1 || (together && !Array.isArray(held(state)))) {
      const one = number(path, label, (value) => scale(value, 0), { unit: unit(0), idle });
      return [{
        ...one,
        read: (s) => [held(s)].flat()[0] ?? idle,
        write: (s, value) => put(s, place(path), value === idle ? undefined : Array.isArray(held(s)) ? [value] : value),
      }];
    }
    return names.map((name, i) => ({
      ...number(`${path}.${i}`, `${label}, ${bare(name)}`, (value) => scale(value, i), { unit: unit(i), idle }),
      read: (s) => (Array.isArray(held(s)) ? held(s)[i] : held(s)) ?? idle,
      write: (s, value) => {
        const old = held(s);
        const values = names.map((_, j) => (j === i ? value : ((Array.isArray(old) ? old[j] : old) ?? idle)));
        return put(s, place(path), values.every((v) => v === idle) ? undefined : values);
      },
    }));
  };
}

function choice(path, label, choices, idle, write) {
  return {
    path,
    label,
    kind: "choice",
    choices,
    read: (state) => String(get(state, place(path)) ?? idle),
    write: write ?? ((state, value) => put(state, place(path), value === idle ? undefined : value)),
  };
}

/** Lists and tables of numbers, as written in a project file. */
function numbers(path, label, { unit = "", optional = false } = {}) {
  return {
    path,
    label,
    kind: "text",
    unit,
    read: (state) => written(get(state, place(path))),
    write: (state, text) => {
      if (!text.trim() && optional) return put(state, place(path), undefined);
      return put(state, place(path), parsed(text, label));
    },
  };
}

function written(value) {
  return value === undefined ? "" : JSON.stringify(value).replaceAll(",", ", ");
}

/**
 * @param {string} text such as "0, 1" or "[[0, 1], [-1, 0, 1]]"
 * @param {string} label for the complaint
 * @returns {any[]}
 */
export function parsed(text, label) {
  let value;
  try {
    value = JSON.parse(`[${text}]`);
  } catch {
    throw new Error(`${label} is “${text}”; give numbers with commas between them, such as [0, 1]`);
  }
  if (!value.length) throw new Error(`${label} is empty; give numbers, such as [0, 1]`);
  return value.length === 1 && text.trim().startsWith("[") ? value[0] : value;
}

const positive = (value) => (value ? decades(value) : fromZero(1));
const upTo = (least) => (value) => fromZero(roundUp(Math.max(4 * Math.abs(value || 0), least)));
const signed = (least) => (value) => {
  const far = roundUp(Math.max(2 * Math.abs(value || 0), least));
  return even(-far, far);
};
const count = (high) => (value) => even(1, Math.max(high, value || 1), 1);

const power = (
  n,
) => (n === 0 ? "constant" : n === 1 ? "s" : `s${[...String(n)].map((digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit]).join("")}`);

function plantFields(project, names) {
  const { plant } = project;
  const y = unitOf(names.outputs[0]);
  const Ts = project.actuator?.Ts ?? 1e-3;
  const model = choice(
    "plant.model",
    "Form",
    [
      ["integrator_lag", "integrator and lag"],
      ["fopdt", "gain and one lag"],
      ["transfer_function", "transfer function"],
      ["state_space", "state space"],
    ],
    "integrator_lag",
    (state, value) => ({ ...state, project: convertPlant(state.project, value) }),
  );
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
  const delay = each("plant.input_delay", "Dead time", names.inputs, upTo(20 * Ts), { unit: () => "s", idle: 0 });
  return (state) => [model, ...(own[plant.model] ?? []), ...delay(state)];
}

/** Entries of A and B that are not zero, with sliders. */
function entryFields(plant) {
  const entries = (name) =>
    (plant[name] ?? []).flatMap((row, i) =>
      [row].flat().flatMap((value, j) =>
        value ? [number(`plant.${name}.${i}.${j}`, `${name}, row ${i + 1}, column ${j + 1}`, positive)] : []
      )
    );
  return () => (plant.model === "state_space" ? [...entries("A"), ...entries("B")] : []);
}

function operatingFields(project, names) {
  const offsets = [
    each("plant.u_offset", "Input counts from", names.inputs, signed(1), {
      unit: (i) => unitOf(names.inputs[i]),
      idle: 0,
    }),
    each("plant.y_offset", "Output counts from", names.outputs, signed(1), {
      unit: (i) => unitOf(names.outputs[i]),
      idle: 0,
    }),
  ];
  const rest = [
    numbers("plant.C", "Output matrix C", { optional: true }),
    numbers("plant.E", "Entry of a measured disturbance, E", { optional: true }),
  ];
  return (state) => [...offsets.flatMap((make) => make(state)), ...rest];
}

function actuatorFields(project, names) {
  const { actuator = {} } = project;
  const Ts = actuator.Ts ?? 1e-3;
  const square = Math.max(...references(project).map(reach)) ** 2;
  const seconds = { unit: () => "s", idle: 0, together: true };
  const parts = [
    each("actuator.min_on", "Shortest time on", names.inputs, upTo(10 * Ts), seconds),
    each("actuator.min_off", "Shortest time off", names.inputs, upTo(10 * Ts), seconds),
    each("actuator.switch_cost", "Price of a switching", names.inputs, upTo(1e-5 * square), {
      idle: 0,
      together: true,
    }),
  ];
  return (state) => [
    numbers("actuator.levels", "Levels"),
    number("actuator.Ts", "Switching period", positive, { unit: "s" }),
    ...parts.flatMap((make) => make(state)),
    ...(names.inputs.length > 1 ? [numbers("actuator.forbidden", "Forbidden combinations", { optional: true })] : []),
  ];
}

function controllerFields(project, names) {
  const { controller = {} } = project;
  const Ts = project.actuator?.Ts ?? 1e-3;
  const endpoint = (controller.objective ?? "endpoint") === "endpoint";
  const bandwidth = each("controller.lam", "Bandwidth", names.outputs, positive, {
    unit: () => "rad/s",
    together: true,
  });
  const weight = each("controller.weight", "Weight", names.outputs, positive, { idle: 1, together: true });
  const objective = choice(
    "controller.objective",
    "Look at",
    [
      ["endpoint", "where the output lands"],
      ["horizon", "the way over many periods"],
    ],
    "endpoint",
    (state, value) => ({ ...state, project: convertObjective(state.project, value) }),
  );
  const tails = [["rest", "what holds the reference"], ["zero", "zero"], ["hold", "the last move"]];
  const tail = choice(
    "controller.tail",
    "Input afterwards",
    endpoint ? tails.slice(0, 2) : tails,
    endpoint ? "rest" : "hold",
  );
  const steps = controller.steps ?? 20;
  return (state) => [
    objective,
    ...(endpoint ? [number("controller.Td", "Settling horizon", positive, { unit: "s" })] : [
      number("controller.steps", "Periods looked at", count(64), { whole: true }),
      number("controller.moves", "Periods with free commands", count(steps), { whole: true, idle: steps }),
      number("controller.move_weight", "Price of a move", upTo(1), { idle: 0 }),
      numbers("controller.window", "First and last period weighed", { optional: true }),
    ]),
    ...(endpoint || controller.lam !== undefined ? bandwidth(state) : []),
    ...weight(state),
    tail,
    ...(endpoint ? [] : [
      choice(
        "controller.terminal",
        "Price of the end",
        [["none", "none"], ["riccati", "of ending away from rest"]],
        "none",
      ),
      number("controller.node_budget", "Sequences tried at most", (value) => decades(value || 1000), { whole: true }),
    ]),
    previewField(endpoint),
    ...(typeof controller.preview === "number"
      ? [{
        ...number("controller.preview", "Seconds ahead", upTo(20 * Ts), { unit: "s" }),
        key: "controller.preview.seconds",
      }]
      : []),
    choice(
      "controller.real",
      "Arithmetic",
      [["float64", "double precision"], ["float32", "single precision"]],
      "float64",
    ),
  ];
}

function previewField(endpoint) {
  const words = [["false", "now"], ["true", "when the output lands"], ...(endpoint ? [["lag", "one lag ahead"]] : []), [
    "seconds",
    "seconds ahead",
  ]];
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

function referenceFields(table, path, name) {
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
    between: choice(`${path}.between`, "Between them", [["pchip", "a smooth curve"], ["linear", "straight lines"], [
      "hold",
      "held",
    ]], "pchip"),
  };
  const uses = {
    constant: ["value"],
    half_sine: ["height", "duration", "start", "offset"],
    sine: ["amplitude", "frequency", "phase", "offset"],
    ramp: ["slope", "start", "offset"],
    steps: ["times", "values"],
    points: ["times", "values", "between"],
  };
  const kind = choice(
    `${path}.kind`,
    "Kind",
    [
      ["constant", "constant"],
      ["half_sine", "half a sinusoid"],
      ["sine", "sinusoid"],
      ["ramp", "ramp"],
      ["steps", "steps"],
      ["points", "points"],
    ],
    "constant",
    (state, value) => put(state, place(path), convertReference(get(state, place(path)), value)),
  );
  return [kind, ...(uses[table.kind] ?? []).map((key) => parts[key])];
}

function truthFields(project, names) {
  const Ts = project.actuator?.Ts ?? 1e-3;
  const estimated = project.estimator !== undefined;
  const measured = estimated ? names.outputs : Array.from(
    { length: names.states },
    (_, i) => (i === 0 && names.states === 1 ? names.outputs[0] : `state ${i + 1}`),
  );
  const far = Math.max(...references(project).map(reach));
  const longest = Math.max(0, ...[project.plant?.input_delay ?? 0].flat());
  const parts = [
    each("simulation.noise", "Noise", measured, upTo(0.02 * far), {
      unit: (i) => (estimated || i === 0 ? unitOf(names.outputs[i]) : ""),
      idle: 0,
    }),
    each("simulation.load", "Unmeasured load", names.inputs, signed(0.5), {
      unit: (i) => unitOf(names.inputs[i]),
      idle: 0,
    }),
    each("simulation.hardware.opening", "Travel time, opening", names.inputs, upTo(5 * Ts), {
      unit: () => "s",
      idle: 0,
      together: true,
    }),
    each("simulation.hardware.closing", "Travel time, closing", names.inputs, upTo(5 * Ts), {
      unit: () => "s",
      idle: 0,
      together: true,
    }),
    each("simulation.hardware.quantum", "Step of the sensor", ["all"], upTo(0.02 * far), { idle: 0, together: true }),
  ];
  const { disturbance } = project.simulation ?? {};
  const flows = typeof disturbance === "number"
    ? [number("simulation.disturbance", "Measured disturbance", signed(1))]
    : disturbance?.high === undefined
    ? []
    : [
      number("simulation.disturbance.gain", "Vent, opening per error", positive),
      number("simulation.disturbance.high", "Vent, largest flow", positive),
    ];
  return (state) => [
    number("options.delay_error", "Dead time wrong by", signed(Math.max(longest, Ts)), { unit: "s", idle: 0 }),
    number("options.gain_error", "Gain wrong by", () => even(-0.5, 0.5, 0.01), { unit: "share", idle: 0 }),
    ...parts.flatMap((make) => make(state)),
    ...flows,
  ];
}

function estimatorFields(project, names) {
  const far = Math.max(...references(project).map(reach));
  const { estimator } = project;
  const start = { process_noise: 1e-6 * far ** 2, measurement_noise: 1e-6 * far ** 2 };
  const tick = {
    path: "estimator",
    label: "Estimate the state from the outputs",
    kind: "tick",
    read: (state) => state.project.estimator !== undefined,
    // a noise per state is none per output
    write: (state, on) =>
      putAll(state, { "project.estimator": on ? start : undefined, "project.simulation.noise": undefined }),
  };
  if (!estimator) return () => [tick];
  const simple = (key) => typeof estimator[key] === "number";
  const variance = (key, label, unit) =>
    simple(key) ? number(`estimator.${key}`, label, positive, { unit }) : numbers(`estimator.${key}`, label, { unit });
  const y = unitOf(names.outputs[0]);
  return () => [
    tick,
    variance("process_noise", "Process noise, variance", ""),
    variance("measurement_noise", "Measurement noise, variance", y ? `${y}²` : ""),
    number("estimator.load", "Drift of an unknown load, variance", upTo(1e-4)),
    number("estimator.gate", "Outliers beyond", () => even(0, 12, 0.5), { unit: "deviations", idle: 6 }),
    number("estimator.gate_limit", "Outliers in a row left out", count(20), { whole: true, idle: 3 }),
  ];
}

function runFields() {
  return () => [
    number("simulation.duration", "Length of the run", positive, { unit: "s" }),
    numbers("simulation.x0", "State at the start", { optional: true }),
    number("simulation.seed", "Seed of the noise", () => even(0, 100, 1), { whole: true }),
  ];
}

/**
 * The groups of fields for a state.
 * @param {object} state with project and options
 * @returns {{id: string, title: string, open: boolean, fields: Field[]}[]}
 */
export function groups(state) {
  const { project } = state;
  const names = sizes(project);
  const tables = references(project);
  const listed = Array.isArray(project.reference);
  const group = (id, title, make, open = false) => ({ id, title, open, fields: make(state) });
  return [
    group("controller", "Controller", controllerFields(project, names), true),
    group("plant", "Plant", plantFields(project, names), true),
    group("actuator", "Actuator", actuatorFields(project, names), true),
    ...tables.map((table, i) =>
      group(
        `reference${i}`,
        listed && tables.length > 1 ? `Reference, ${bare(names.outputs[i] ?? "")}` : "Reference",
        () => referenceFields(table, listed ? `reference.${i}` : "reference", names.outputs[i] ?? ""),
        i === 0,
      )
    ),
    group("truth", "What the model does not know", truthFields(project, names)),
    group("estimator", "Estimator", estimatorFields(project, names)),
    group("run", "Run", runFields()),
    group("operating", "Operating point and outputs", operatingFields(project, names)),
    group("entries", "Entries of A and B", entryFields(project.plant ?? {})),
  ].filter((each) => each.fields.length);
}

/**
 * What a field means, in the schema's words.
 * @param {string} path
 * @param {Record<string, {description: string}>} schema
 * @returns {string}
 */
export function meaning(path, schema) {
  const key = path.replace(/^reference\.\d+/, "reference").replace(/(\.\d+)+$/, "");
  return schema[key]?.description ?? ERRORS[key.replace("options.", "")] ?? "";
}
