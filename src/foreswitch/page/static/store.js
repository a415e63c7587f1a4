// What the page knows: one object of parts. All may read it; a part is changed by its one owner.

import { fresh } from "./settings.js";

/**
 * @typedef {object} Parts
 * @property {import("./settings.js").Settings} settings owner: main.js
 * @property {boolean} dragging whether a slider is held; owner: main.js
 * @property {Last} last owner: runs.js
 * @property {string} refused key of settings of which no run can be made; owner: runs.js
 * @property {any} proof of what is seen, the reply to "certify"; undefined: not there yet; owner: runs.js
 * @property {any} early a proof that came before its run; owner: runs.js
 * @property {Record<string, import("./beside.js").Held>} beside owner: beside.js
 * @property {Record<string, string>} notices by matter; owner: telling.js
 *
 * @typedef {object} Last the last settings of which a run could be made
 * @property {string} key
 * @property {import("./settings.js").Asked|null} settings
 * @property {any} run reply to "look"; null: none was made yet
 * @property {any} proof as above
 *
 * @typedef {object} Store
 * @property {() => Readonly<Parts>} now the parts as they are; later changes leave this object as it is
 * @property {(...names: (keyof Parts)[]) => (change: Partial<Parts>) => void} own takes parts over: the only means of
 *   changing them
 */

/**
 * @param {object} project that the page begins with
 * @returns {Store}
 */
export function store(project) {
  const owned = new Set();
  /** @type {Readonly<Parts>} */
  let parts = Object.freeze({
    settings: fresh(project),
    dragging: false,
    last: { key: "", settings: null, run: null, proof: undefined },
    refused: "",
    proof: undefined,
    early: undefined,
    beside: {},
    notices: {},
  });

  return {
    now: () => parts,
    own(...names) {
      for (const name of names) {
        if (!Object.hasOwn(parts, name)) throw new Error(`the store has no part “${name}”`);
        if (owned.has(name)) throw new Error(`“${name}” has an owner already`);
        owned.add(name);
      }
      const mine = new Set(/** @type {string[]} */ (names));
      return (change) => {
        const foreign = Object.keys(change).find((name) => !mine.has(name));
        if (foreign) throw new Error(`“${foreign}” is changed by its owner alone`);
        parts = Object.freeze({ ...parts, ...change });
      };
    },
  };
}
