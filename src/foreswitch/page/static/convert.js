// Another form of plant, objective or reference, started from what the present one says.

const PLANT_ALWAYS = ["input_delay", "u_offset", "y_offset", "input_names", "output_names"];

/** What a simulation says of the old states. */
const OF_STATES = ["x0", "noise", "disturbance", "plant"];

const omit = (table, keys) => Object.fromEntries(Object.entries(table).filter(([key]) => !keys.includes(key)));
const pick = (table, keys) =>
  Object.fromEntries(keys.filter((key) => table[key] !== undefined).map((key) => [key, table[key]]));

/** Numerator and denominator, or undefined where the form has several inputs or outputs. */
function transfer(plant) {
  if (plant.model === "integrator_lag") return { num: [plant.k / plant.c], den: [1, 1 / plant.c, 0] };
  if (plant.model === "fopdt") return { num: [plant.K / plant.T], den: [1, 1 / plant.T] };
  return plant.model === "transfer_function" ? { num: plant.num, den: plant.den } : undefined;
}

/** States y, y', ...; only without zeros, as the package has it. */
function stateSpace({ num, den }) {
  const [lead, ...rest] = den;
  const n = rest.length;
  const A = Array.from(
    { length: n },
    (_, i) => Array.from({ length: n }, (_, j) => (i === n - 1 ? -rest[n - 1 - j] / lead + 0 : Number(j === i + 1))),
  );
  const B = Array.from({ length: n }, (_, i) => [i === n - 1 ? num.at(-1) / lead : 0]);
  return { A, B };
}

/**
 * A project whose plant has another form: the same plant where that can be, else one that begins alike.
 * @param {object} project
 * @param {string} model
 * @returns {object}
 */
export function convertPlant(project, model) {
  const { plant } = project;
  const tf = transfer(plant);
  const duration = project.simulation?.duration ?? 1;
  // the slope of a first-order plant, the curvature of a second-order one
  const rise = tf ? tf.num.at(-1) / tf.den[0] : 1;
  const slope = plant.k ?? (plant.T ? plant.K / plant.T : rise);
  const own = {
    integrator_lag: { k: slope, c: plant.c ?? duration / 100 },
    fopdt: { K: slope * (plant.T ?? duration), T: plant.T ?? duration },
    transfer_function: tf ?? { num: [1], den: [1, 0] },
    state_space: stateSpace(tf ?? { num: [1], den: [1, 0] }),
  }[model];
  const several = (plant.B?.[0]?.length ?? 1) > 1 || (plant.C?.length ?? 1) > 1;
  const simulation = omit(project.simulation ?? {}, OF_STATES);
  const changed = { ...project, plant: { model, ...own, ...(several ? {} : pick(plant, PLANT_ALWAYS)) }, simulation };
  if (!several) return changed;
  const { levels, Ts } = project.actuator;
  const reference = [project.reference].flat()[0];
  return { ...changed, actuator: { levels: Array.isArray(levels[0]) ? levels[0] : levels, Ts }, reference };
}

/**
 * A project with the other objective.
 * @param {object} project
 * @param {string} objective "endpoint" or "horizon"
 * @returns {object}
 */
export function convertObjective(project, objective) {
  const { controller, actuator } = project;
  const kept = pick(controller, ["weight", "relative_degree", "bad_limit", "real", "preview"]);
  if (objective === "endpoint") {
    const Td = actuator.Ts * (controller.steps ?? 20);
    return { ...project, controller: { ...kept, Td, lam: [controller.lam ?? 1 / Td].flat()[0] } };
  }
  const steps = Math.min(10, Math.max(1, Math.round((controller.Td ?? 10 * actuator.Ts) / actuator.Ts)));
  const preview = controller.preview === "lag" ? true : controller.preview;
  return { ...project, controller: { ...kept, objective, steps, ...(preview === undefined ? {} : { preview }) } };
}

/**
 * A reference of another kind with the same reach.
 * @param {object} table
 * @param {string} kind
 * @returns {object}
 */
export function convertReference(table, kind) {
  const times = table.times ?? [];
  const length = table.duration ?? (times.at(-1) || (table.frequency ? 1 / table.frequency : 1));
  const top = table.height ?? (table.amplitude && 2 * table.amplitude) ?? table.value ??
    (table.slope && table.slope * length) ?? Math.max(1e-9, ...(table.values ?? [1]));
  const offset = pick(table, ["offset"]);
  const start = pick(table, ["start"]);
  return {
    kind,
    ...{
      constant: { value: top },
      half_sine: { height: top, duration: length, ...start, ...offset },
      sine: { amplitude: top / 2, frequency: 1 / length, ...offset },
      ramp: { slope: top / length, ...start, ...offset },
      steps: { times: table.times ?? [0, length], values: table.values ?? [0, top] },
      points: { times: table.times ?? [0, length], values: table.values ?? [0, top] },
    }[kind],
  };
}
