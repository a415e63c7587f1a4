// What a project's tables say of its sizes, names and units, as far as the page needs it before the server answers.

const list = (value) => (Array.isArray(value) ? value : [value]);

/**
 * The unit in a name such as "pressure [kPa]".
 * @param {string|undefined} name
 * @returns {string}
 */
export function unitOf(name) {
  return /\[([^\]]*)\]\s*$/.exec(name ?? "")?.[1] ?? "";
}

/**
 * A name without its unit.
 * @param {string} name
 * @returns {string}
 */
export function bare(name) {
  return name.replace(/\s*\[[^\]]*\]\s*$/, "");
}

/**
 * The references of a project, one per output.
 * @param {object} project
 * @returns {object[]}
 */
export function references(project) {
  return list(project.reference ?? {});
}

/**
 * How far a reference reaches, for the range of sliders.
 * @param {object} table of one reference
 * @returns {number}
 */
export function reach(table) {
  const values = [table.height, 2 * table.amplitude, table.slope, table.value, ...(table.values ?? [])];
  return Math.max(...values.map((value) => Math.abs(Number(value)) || 0)) || 1;
}

/**
 * Numbers and names of states, inputs and outputs.
 * @param {object} project
 * @returns {{states: number, inputs: string[], outputs: string[]}}
 */
export function sizes(project) {
  const { plant = {}, actuator = {} } = project;
  const states = {
    integrator_lag: 2,
    fopdt: 1,
    transfer_function: plant.den?.length - 1,
    state_space: plant.A?.length,
  };
  const inputs = plant.model === "state_space"
    ? list(plant.B?.[0] ?? 0).length
    : Array.isArray(actuator.levels?.[0])
    ? actuator.levels.length
    : 1;
  const outputs = plant.C?.length ?? 1;
  const names = (given, count, word) =>
    Array.from({ length: count }, (_, i) => given?.[i] ?? (count > 1 ? `${word} ${i + 1}` : word));
  return {
    states: states[plant.model] || 1,
    inputs: names(plant.input_names, inputs, "input"),
    outputs: names(plant.output_names, outputs, "output"),
  };
}

/**
 * The first table that a project lacks.
 * @param {object} project
 * @returns {string|undefined}
 */
export function lacking(project) {
  const there = (table) => typeof table === "object" && table !== null;
  return ["plant", "actuator", "controller", "reference", "simulation"].find((name) => !there(project?.[name]));
}
