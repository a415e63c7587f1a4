// The address bar holds the state: a link, safe over a reload, undone by the browser's back button.

import { decode, encode } from "./link.js";

/** Changes of one field closer together than this are one step back [ms]. */
const ONE_STEP = 1200;
/** Browsers refuse more than about 200 changes of the address in half a minute [ms]. */
const PAUSE = 200;

/**
 * @param {(state: object|null) => void} arrived called with the state of an address gone to; null: damaged
 * @param {(long: boolean) => void} told called whenever the address follows, or not: the state is too long for it
 * @returns {{read: () => Promise<object|null|undefined>, note: (state: object, what: string) => void}}
 */
export function address(arrived, told) {
  let written = location.hash.slice(1);
  let last = { what: "", at: -Infinity };
  let waiting = null;

  async function write() {
    const { state, push } = waiting;
    waiting = null;
    const text = await encode(state);
    told(!text);
    if (text === written) return;
    written = text;
    history[push ? "pushState" : "replaceState"](null, "", text ? `#${text}` : location.pathname);
  }

  async function read() {
    const text = location.hash.slice(1);
    written = text;
    if (!text) return undefined;
    return await decode(text).catch(() => null);
  }

  addEventListener("popstate", async () => {
    waiting = null;
    last = { what: "", at: -Infinity };
    const state = await read();
    if (state !== undefined) arrived(state);
  });

  function note(state, what) {
    const now = performance.now();
    const apart = what !== last.what || now - last.at > ONE_STEP;
    last = { what, at: now };
    if (waiting) waiting = { state, push: waiting.push || (apart && what !== "") };
    else {
      waiting = { state, push: apart && what !== "" };
      setTimeout(() => waiting && write(), PAUSE);
    }
  }

  return { read, note };
}
