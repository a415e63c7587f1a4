// Places in nested tables, "plant.input_delay.0"; tables are never changed, a changed copy is made.

/**
 * @param {object} table
 * @param {string} path
 * @returns {any} undefined where nothing is
 */
export function get(table, path) {
  return path.split(".").reduce((value, key) => value?.[key], table);
}

/**
 * A copy with one value changed.
 * @param {object} table
 * @param {string} path
 * @param {any} value undefined removes the key, and tables that this leaves empty
 * @returns {object}
 */
export function put(table, path, value) {
  const [key, ...rest] = path.split(".");
  const copy = Array.isArray(table) ? [...table] : { ...table };
  const below = rest.length ? put(copy[key] ?? {}, rest.join("."), value) : value;
  const emptied = rest.length && value === undefined && !Array.isArray(below) && !Object.keys(below).length;
  if (below === undefined || emptied) delete copy[key];
  else copy[key] = below;
  return copy;
}

/**
 * A copy with several values changed.
 * @param {object} table
 * @param {Record<string, any>} values by path
 * @returns {object}
 */
export function putAll(table, values) {
  return Object.entries(values).reduce((copy, [path, value]) => put(copy, path, value), table);
}
