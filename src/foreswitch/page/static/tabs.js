// Tabs as readers of screens and keyboards know them: arrow keys move, Tab leaves.

import { byId } from "./dom.js";

/**
 * @param {(id: string) => void} opened
 * @returns {(id: string) => void} opens one
 */
export function tabs(opened) {
  /** @type {HTMLElement[]} */
  const all = Array.from(document.querySelectorAll('[role="tab"]'));

  function open(id) {
    for (const tab of all) {
      const mine = tab.getAttribute("aria-controls") === id;
      tab.setAttribute("aria-selected", String(mine));
      tab.tabIndex = mine ? 0 : -1;
      byId(tab.getAttribute("aria-controls")).hidden = !mine;
    }
    opened(id);
  }

  all.forEach((tab, i) => {
    tab.addEventListener("click", () => open(tab.getAttribute("aria-controls")));
    tab.addEventListener("keydown", (event) => {
      const to = { ArrowRight: i + 1, ArrowLeft: i - 1, Home: 0, End: all.length - 1 }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      const next = all[(to + all.length) % all.length];
      next.focus();
      next.click();
    });
  });
  return open;
}
