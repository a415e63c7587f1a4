// Runs beside the present one: those of pinned settings, and of simple laws tuned for the same task.

import { BASELINES } from "./compare.js";
import { asked, key } from "./settings.js";

/**
 * @typedef {object} Held of a pin, by the key of its settings, or of a simple law, by its name
 * @property {string} key of the settings that were asked for
 * @property {boolean} [waiting] for the reply
 * @property {object} [run]
 * @property {object} [proof]
 * @property {object} [error]
 */

/** Settings that the laws are tuned for: the present ones, or where no run can be made of them those before. */
function meant({ settings, last, refused }) {
  return refused === key(settings) && last.run ? last.settings : asked(settings);
}

/**
 * Runs beside the present one in their order, with the number of their colour.
 * @param {import("./store.js").Parts} now
 * @returns {(Held & {label: string, place: string, colour: number, law: boolean})[]}
 */
export function drawn(now) {
  const { pins, baselines } = now.settings.view;
  const pinned = pins.map((pin, i) => ({ label: pin.name, place: key(pin), colour: i, law: false }));
  const laws = BASELINES
    .map(([which, words], i) => ({ label: words, place: which, colour: pins.length + i, law: true }))
    .filter(({ place }) => baselines.includes(place));
  const present = key(meant(now));
  return [...pinned, ...laws].map((each) => {
    const held = now.beside[each.place];
    const waiting = Boolean(held?.waiting || (each.law && held && held.key !== present));
    const label = waiting && each.law ? `${each.label} (being tuned …)` : each.label;
    return { ...each, ...held, waiting, label };
  });
}

/**
 * @param {import("./store.js").Store} store
 * @param {{ask: Function}} server
 * @param {{overlays: () => void, table: () => void}} readout
 * @returns {() => void} asks for what is to stand beside the run and is not there yet
 */
export function asksBeside(store, server, readout) {
  const change = store.own("beside");
  const numbers = new Map(); // of pinned settings, for short names of their lanes to the server

  const hold = (place, held) => change({ beside: { ...store.now().beside, [place]: held } });

  function laneOf(pin) {
    if (!numbers.has(key(pin))) numbers.set(key(pin), numbers.size);
    return `pin ${numbers.get(key(pin))}`;
  }

  function ask(place, { kind, lane, body }) {
    const mine = key(body);
    const held = store.now().beside[place];
    if (held?.key === mine) return;
    hold(place, { ...held, error: undefined, key: mine, waiting: true });
    const current = () => store.now().beside[place]?.key === mine;
    server.ask(kind, lane, body, (reply) => {
      if (!current()) return;
      const { proof } = store.now().beside[place];
      hold(place, { key: mine, proof, ...(reply.error ? { error: reply.error } : { run: reply }) });
      readout.overlays();
    });
    if (kind !== "look") return;
    server.ask("certify", lane, body, (reply) => {
      if (!current()) return;
      hold(place, { ...store.now().beside[place], proof: reply.error ? { holds: false } : reply });
      readout.table();
    });
  }

  return () => {
    const now = store.now();
    const { pins, baselines } = now.settings.view;
    const wanted = new Map(pins.map((pin) => [key(pin), { kind: "look", lane: laneOf(pin), body: asked(pin) }]));
    for (const which of baselines) wanted.set(which, { kind: "baseline", lane: which, body: { which, ...meant(now) } });
    change({ beside: Object.fromEntries(Object.entries(now.beside).filter(([place]) => wanted.has(place))) });
    for (const [place, what] of wanted) ask(place, what);
    readout.overlays();
  };
}
