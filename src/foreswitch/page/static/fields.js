// What can be set, in groups, for the project at hand. Descriptions come with the server's schema.

import {
  actuatorFields,
  controllerFields,
  entryFields,
  estimatorFields,
  operatingFields,
  plantFields,
} from "./designfields.js";
import { referenceFields, runFields, truthFields } from "./simulationfields.js";
import { bare, references, sizes } from "./sizes.js";

const ERRORS = {
  delay_error: "how much longer the true dead time is than the model's; negative: shorter",
  gain_error: "how much larger the true gain is than the model's, as a share",
};

/**
 * The groups of fields for a state.
 * @param {object} state with project and options
 * @returns {{id: string, title: string, open: boolean, fields: import("./fieldkinds.js").Field[]}[]}
 */
export function groups(state) {
  const { project } = state;
  const names = sizes(project);
  const tables = references(project);
  const listed = Array.isArray(project.reference);
  const group = (id, title, fields, open = false) => ({ id, title, open, fields });
  return [
    group("controller", "Controller", controllerFields(state, names), true),
    group("plant", "Plant", plantFields(state, names), true),
    group("actuator", "Actuator", actuatorFields(state, names), true),
    ...tables.map((table, i) =>
      group(
        `reference${i}`,
        listed && tables.length > 1 ? `Reference, ${bare(names.outputs[i] ?? "")}` : "Reference",
        referenceFields(table, listed ? `reference.${i}` : "reference", names.outputs[i] ?? ""),
        i === 0,
      )
    ),
    group("truth", "What the model does not know", truthFields(state, names)),
    group("estimator", "Estimator", estimatorFields(state, names)),
    group("run", "Run", runFields()),
    group("operating", "Operating point and outputs", operatingFields(state, names)),
    group("entries", "Entries of A and B", entryFields(state)),
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
