// What is told beside the picture: aloud to readers of screens, in one notice for each matter, at the field concerned.

import { byId } from "./dom.js";
import { sentence } from "./words.js";

/**
 * @param {string} text said by readers of screens
 */
export function speak(text) {
  byId("spoken").textContent = text;
}

/**
 * @param {import("./store.js").Store} store
 * @returns {(matter: string, text: string) => void} notices a matter: the server, a file, a link; an empty text ends it
 */
export function noticing(store) {
  const change = store.own("notices");
  return (matter, text) => {
    const { notices } = store.now();
    if ((notices[matter] ?? "") === text) return; // not spoken again
    change({ notices: { ...notices, [matter]: text } });
    const line = byId("notice");
    line.textContent = Object.values(store.now().notices).filter(Boolean).join(" ");
    line.hidden = !line.textContent;
  };
}

/**
 * Why there is no run of the settings; told beside its field where there is one.
 * @param {{message: string, field: string|null}|null} error null: there is one
 * @param {(error: object|null) => boolean} complain at the field; whether it has one
 * @param {boolean} drawn whether an earlier run is still in the picture
 */
export function tellTrouble(error, complain, drawn) {
  const shown = complain(error);
  const line = byId("trouble");
  const rest = drawn ? " The picture is of the last settings that worked." : "";
  line.hidden = !error;
  line.textContent = error ? `${sentence(error.message)}${rest}` : "";
  document.body.classList.toggle("old", Boolean(error));
  if (error) speak(shown ? error.message : line.textContent);
}
