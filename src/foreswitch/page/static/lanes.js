// Commands as stairs, each input on a lane of its own with its levels between 0 and 1.

import { show } from "./scale.js";

/** Distance of one input's stairs from the next, in their height. */
const LANE = 1.6;
/** Names of levels stand beside a lane, all of so many; of more the ends. */
const NAMED = 3;

const ends = (levels) => [levels[0], levels.at(-1)];

/**
 * Height of a lane's lowest level.
 * @param {object} run
 * @param {number} j of the input
 * @returns {number}
 */
export const base = (run, j) => (run.inputs.length - 1 - j) * LANE;

/** A level's height on its lane. */
function height(run, j, level) {
  const [low, high] = ends(run.levels[j]);
  return base(run, j) + (level - low) / (high - low || 1);
}

/**
 * Lowest and highest of what is drawn, the names above the lanes included.
 * @param {object} run
 * @returns {[number, number]}
 */
export function lanesRange(run) {
  const inputs = run.inputs.length;
  return [-0.15, (inputs - 1) * LANE + (inputs > 1 ? 1.55 : 1.15)];
}

/**
 * Marks of the axis: the levels, from below.
 * @param {object} run
 * @returns {{at: number, text: string}[]}
 */
export function laneMarks(run) {
  return run.levels
    .flatMap((levels, j) =>
      (levels.length <= NAMED ? levels : ends(levels)).map((level) => ({
        at: height(run, j, level),
        text: show(level),
      }))
    )
    .sort((a, b) => a.at - b.at);
}

/**
 * An input's commands on its lane; the last one holds to the end.
 * @param {object} run
 * @param {number} j
 * @returns {Float32Array}
 */
export function stairs(run, j) {
  const commands = run.u[j];
  const heights = new Float32Array(commands.length + 1);
  for (let k = 0; k < commands.length; k++) heights[k] = height(run, j, commands[k]);
  heights[commands.length] = heights[commands.length - 1];
  return heights;
}
