// Runs beside the present one: pinned settings, and simple laws tuned for the same task.

import { byId, make } from "./dom.js";
import { DASHES, otherColour } from "./colours.js";
import { show } from "./scale.js";
import { unitOf } from "./sizes.js";

export const BASELINES = [["relay", "relay with hysteresis"], ["pi_pwm", "PI with pulse width modulation"], [
  "smith_pwm",
  "Smith predictor with pulse width modulation",
]];

/** Unit of a simple law's parameter, where the output has unit y. */
function measure(key, y) {
  const one = { lead: "s", carrier: "s", preview: "s", hysteresis: y, deadband: y };
  const gain = { kp: "1/", ki: "1/s/", kd: "s/", kf: "s/" }[key];
  return one[key] ?? (gain && y ? gain + y : "");
}

/** What is told of a simple law: its parameters, once they are there. */
function tuned(found) {
  if (found?.error) return found.error.message;
  if (!found?.parameters) return "being tuned …";
  const unit = unitOf(found.outputs?.[0]);
  return Object.entries(found.parameters)
    .map(([key, value]) => `${key} ${show(value)} ${measure(key, unit)}`.trim())
    .join(", ");
}

/**
 * A line of the legend: colour and dashes as drawn.
 * @param {string} colour name in the style sheet
 * @param {number[]} dash
 * @returns {Element}
 */
export function swatch(colour, dash = []) {
  const drawn = (tag, attributes) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    return element;
  };
  const svg = drawn("svg", { viewBox: "0 0 28 8", "aria-hidden": "true", class: "swatch" });
  svg.append(drawn("path", { d: "M0 4h28", class: `line-${colour}`, "stroke-dasharray": dash.join(" ") }));
  return svg;
}

/**
 * @typedef {object} Acts
 * @property {(name: string) => void} pin
 * @property {(i: number) => void} unpin
 * @property {(i: number) => void} use
 * @property {(which: string, on: boolean) => void} toggle
 *
 * @param {Acts} acts
 * @returns {{show: (view: object, baselines: Record<string, object>) => void}}
 */
export function comparePanel(acts) {
  const name = byId("pin-name");
  byId("pinning").addEventListener("submit", (event) => {
    event.preventDefault();
    acts.pin(name.value.trim());
    name.value = "";
  });
  const boxes = new Map();
  for (const [which, words] of BASELINES) {
    const box = make("input", {
      type: "checkbox",
      id: `baseline-${which}`,
      "aria-describedby": `baseline-${which}-about`,
    });
    const about = make("p", { className: "about", id: `baseline-${which}-about` });
    box.addEventListener("change", () => acts.toggle(which, box.checked));
    byId("baselines").append(make("label", { className: "tick", for: box.id }, box, ` ${words}`), about);
    boxes.set(which, { box, about });
  }
  let listed = "";

  return {
    show(view, baselines) {
      const now = JSON.stringify(view.pins.map((pin) => pin.name));
      if (now !== listed) {
        listed = now;
        const buttons = () => Array.from(byId("pins").querySelectorAll("button"));
        const at = buttons().indexOf(document.activeElement);
        byId("pins").replaceChildren(...view.pins.map((pin, i) => {
          const use = make("button", { type: "button", "aria-label": `Set everything as in ${pin.name}` }, "Use");
          const remove = make("button", { type: "button", "aria-label": `Remove ${pin.name}` }, "Remove");
          use.addEventListener("click", () => acts.use(i));
          remove.addEventListener("click", () => acts.unpin(i));
          return make("li", {}, swatch(otherColour(i), DASHES[i % 4]), make("span", {}, pin.name), use, remove);
        }));
        if (at >= 0) (buttons()[at] ?? buttons().at(-1) ?? name).focus(); // on what follows
      }
      for (const [which, { box, about }] of boxes) {
        const on = view.baselines.includes(which);
        box.checked = on;
        const found = baselines[which];
        about.classList.toggle("complaint", Boolean(on && found?.error));
        about.textContent = on ? tuned(found) : "";
      }
    },
  };
}
