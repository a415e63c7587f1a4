// A state as text for the address bar, and back.

/** Chromium shortens no address below this; a longer one could not be opened again. */
const LONGEST = 1_500_000;

/** @param {any} value */
const table = (value) => typeof value === "object" && value !== null && !Array.isArray(value);

async function through(bytes, stream) {
  return new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(stream)).arrayBuffer());
}

/**
 * @param {object} state
 * @returns {Promise<string>} base64url; empty where it would be too long for an address
 */
export async function encode(state) {
  const packed = await through(new TextEncoder().encode(JSON.stringify(state)), new CompressionStream("deflate-raw"));
  let binary = "";
  for (let i = 0; i < packed.length; i += 0x8000) binary += String.fromCharCode(...packed.subarray(i, i + 0x8000));
  const text = btoa(binary).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
  return text.length > LONGEST ? "" : text;
}

/**
 * @param {string} text
 * @returns {Promise<object>}
 * @throws {Error} where it is damaged
 */
export async function decode(text) {
  const binary = atob(text.replaceAll("-", "+").replaceAll("_", "/"));
  const packed = Uint8Array.from(binary, (letter) => letter.charCodeAt(0));
  const state = JSON.parse(new TextDecoder().decode(await through(packed, new DecompressionStream("deflate-raw"))));
  const { v, project, options = {}, view = {} } = state ?? {};
  if (v !== 1 || ![project, options, view].every(table)) throw new Error("no state");
  const { pins = [], baselines = [], step = null } = view;
  const pinned = (pin) => table(pin) && typeof pin.name === "string" && table(pin.project) && table(pin.options ?? {});
  if (!Array.isArray(pins) || !pins.every(pinned) || !Array.isArray(baselines)) throw new Error("no view");
  if (step !== null && !(Number.isInteger(step) && step >= 0)) throw new Error("no step");
  return state;
}
