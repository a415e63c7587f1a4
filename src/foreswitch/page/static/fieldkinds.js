// The kinds of fields: a number, several of a kind, a choice, a list as text. A field reads its value from the state
// and writes a changed state; it knows nothing of the page.

import { get, put } from "./paths.js";
import { decades, even, fromZero, roundUp } from "./scale.js";
import { bare } from "./sizes.js";

/** @param {string} path as the server names it: of the project, or beginning with "options" */
export const place = (path) => (path.startsWith("options.") ? path : `project.${path}`);

/** @typedef {import("./scale.js").Scale} Scale */

/**
 * @typedef {object} Field
 * @property {string} path as the server names it in complaints
 * @property {string} [key] of its own, where two fields are of one path
 * @property {string} label
 * @property {"number"|"choice"|"text"|"tick"} kind
 * @property {string} [unit]
 * @property {(state: object) => any} read
 * @property {(state: object, value: any) => object} write
 * @property {(value: number) => Scale} [scale] of the slider, made for a value
 * @property {boolean} [whole] whole numbers only
 * @property {[string, string][]} [choices] value and words
 */

/**
 * A number under a key of its own.
 * @param {string} path
 * @param {string} label
 * @param {(value: number) => Scale} scale
 * @param {{unit?: string, idle?: number, whole?: boolean}} [more] equal to `idle`, the key is left out
 * @returns {Field}
 */
export function number(path, label, scale, { unit = "", idle, whole = false } = {}) {
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

/**
 * Numbers of which the file holds one for all or a list: one field for each name.
 * @param {object} state whose tables say whether the file holds a list
 * @param {string} path
 * @param {string} label
 * @param {string[]} names
 * @param {(value: number, i: number) => Scale} scale
 * @param {{unit?: (i: number) => string, idle?: number, together?: boolean}} [more] together: one field for one number
 * @returns {Field[]}
 */
export function each(state, path, label, names, scale, { unit = () => "", idle, together = false } = {}) {
  const held = (s) => get(s, place(path));
  if (names.length === 1 || (together && !Array.isArray(held(state)))) {
    const one = number(path, label, (value) => scale(value, 0), { unit: unit(0), idle });
    const stored = (s, value) => (value === idle ? undefined : Array.isArray(held(s)) ? [value] : value);
    return [{
      ...one,
      read: (s) => [held(s)].flat()[0] ?? idle,
      write: (s, value) => put(s, place(path), stored(s, value)),
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
}

/**
 * One of several words.
 * @param {string} path
 * @param {string} label
 * @param {[string, string][]} choices value and words
 * @param {string} idle chosen where the file says nothing
 * @param {(state: object, value: string) => object} [write] where more changes than the word
 * @returns {Field}
 */
export function choice(path, label, choices, idle, write) {
  return {
    path,
    label,
    kind: "choice",
    choices,
    read: (state) => String(get(state, place(path)) ?? idle),
    write: write ?? ((state, value) => put(state, place(path), value === idle ? undefined : value)),
  };
}

/**
 * Lists and tables of numbers, as written in a project file.
 * @param {string} path
 * @param {string} label
 * @param {{unit?: string, optional?: boolean}} [more]
 * @returns {Field}
 */
export function numbers(path, label, { unit = "", optional = false } = {}) {
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

/** Three decades about the value. */
export const positive = (value) => (value ? decades(value) : fromZero(1));
/** From zero to four times the value, or to the least that a slider is to reach. */
export const upTo = (least) => (value) => fromZero(roundUp(Math.max(4 * Math.abs(value || 0), least)));
/** Both signs, to twice the value or the least. */
export const signed = (least) => (value) => {
  const far = roundUp(Math.max(2 * Math.abs(value || 0), least));
  return even(-far, far);
};
/** Whole numbers from one. */
export const count = (high) => (value) => even(1, Math.max(high, value || 1), 1);
