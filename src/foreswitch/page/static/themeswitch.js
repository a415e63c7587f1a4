// Light, dark, or as the system has it.

import { byId } from "./dom.js";

const ORDER = { auto: "light", light: "dark", dark: "auto" };
const WORDS = { auto: "as the system", light: "light", dark: "dark" };

/** @param {() => void} changed for what is drawn with colours of its own */
export function themeSwitch(changed) {
  const root = document.documentElement;
  const button = byId("theme");
  const now = () => root.dataset.theme ?? "auto";

  function label() {
    button.textContent = { auto: "◐", light: "☀", dark: "☾" }[now()];
    button.setAttribute("aria-label", `Colours: ${WORDS[now()]}`);
    button.title = button.getAttribute("aria-label");
  }

  button.addEventListener("click", () => {
    const next = ORDER[now()];
    if (next === "auto") delete root.dataset.theme;
    else root.dataset.theme = next;
    try {
      localStorage.setItem("foreswitch.theme", next);
    } catch {
      // without storage it lasts until the page is left
    }
    label();
    changed();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
  matchMedia("print").addEventListener("change", changed);
  label();
}
