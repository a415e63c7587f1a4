// Settings: a project's tables, the options of its run, and what is looked at. They are what a link holds; they are
// never changed, a changed copy is made.

import { groups } from "./fields.js";
import { lacking } from "./sizes.js";

/**
 * @typedef {object} Asked what a run depends on
 * @property {object} project tables of a project file
 * @property {object} options
 *
 * @typedef {Asked & {name: string}} Pin settings kept for comparison
 *
 * @typedef {object} View
 * @property {Pin[]} pins
 * @property {string[]} baselines
 * @property {number|null} step of the cursor
 *
 * @typedef {Asked & {v: 1, view: View}} Settings
 */

/**
 * @param {object} project
 * @returns {Settings}
 */
export const fresh = (project) => ({ v: 1, project, options: {}, view: { pins: [], baselines: [], step: null } });

/**
 * @param {Asked} settings
 * @returns {Asked} without what a run does not depend on
 */
export const asked = ({ project, options }) => ({ project, options });

/**
 * @param {Asked} settings
 * @returns {string} equal where runs are equal
 */
export const key = ({ project, options }) => JSON.stringify([project, options]);

/**
 * Why a project cannot even be shown; other mistakes are told beside their fields.
 * @param {any} project
 * @returns {string} empty where it can be
 */
export function flaw(project) {
  const table = lacking(project);
  if (table) return `The file has no table [${table}]; add it.`;
  try {
    groups(fresh(project));
  } catch {
    return "The file holds lists or tables where others belong; “foreswitch simulate” says which.";
  }
  return "";
}

/**
 * Whether nothing can be shown of a link.
 * @param {any} linked
 * @returns {boolean}
 */
export function damaged(linked) {
  return !linked || [linked, ...(linked.view?.pins ?? [])].some((each) => flaw(each.project));
}

/**
 * With everything that a link made by hand may leave out.
 * @param {any} linked
 * @returns {Settings}
 */
export function whole(linked) {
  const empty = fresh(linked.project);
  return { ...empty, ...linked, options: linked.options ?? {}, view: { ...empty.view, ...linked.view } };
}
