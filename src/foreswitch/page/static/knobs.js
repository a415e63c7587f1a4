// The fields of the page: a slider and a number for each number, kept in step with the state.

import { make } from "./dom.js";
import { clean, show, STEPS } from "./scale.js";

const keyOf = (field) => field.key ?? field.path;
const slug = (field) => `knob-${keyOf(field).replaceAll(".", "-")}`;

/** All of a field that its row is built from. */
const looks = ({ key, path, label, kind, unit, choices }) => [key, path, label, kind, unit, choices];

/** What one press of an arrow key adds in a number field: one in the second digit. */
function nudge(value) {
  return value ? clean(10 ** (Math.floor(Math.log10(Math.abs(value))) - 1)) : 0.001;
}

/**
 * @typedef {object} Knobs
 * @property {(groups: object[], state: object, afresh: boolean) => void} show
 * @property {(error: {message: string, field: string|null}|null) => boolean} complain at the field; whether it has one
 *
 * @param {HTMLElement} root
 * @param {(change: (state: object) => object, how: {path: string, done: boolean}) => void} changed done: not dragged
 * @param {(path: string) => string} describe
 * @returns {Knobs}
 */
export function knobs(root, changed, describe) {
  let shape = "";
  let rows = new Map(); // key, most often the path -> {field, element, update, complaint}
  const folded = new Map(); // group -> open, as the reader left it

  /** own: seen here, so that what the server says of other fields does not end it. */
  function complainAt(row, message, own = false) {
    row.own = own;
    row.complaint.textContent = message;
    row.complaint.hidden = !message;
    for (const input of row.inputs) {
      if (message) input.setAttribute("aria-invalid", "true");
      else input.removeAttribute("aria-invalid");
    }
  }

  function commit(row, value, done) {
    try {
      if (row.own) complainAt(row, "");
      changed((state) => row.field.write(state, value), { path: keyOf(row.field), done });
    } catch (error) {
      complainAt(row, error.message, true);
    }
  }

  function numberRow(row, id, described) {
    const { field } = row;
    const label = make("label", { for: id }, field.label);
    const unit = make("span", { className: "unit" }, field.unit ?? "");
    const slider = make("input", {
      type: "range",
      id: `${id}-slider`,
      min: 0,
      max: STEPS,
      step: 1,
      "aria-label": `${field.label}, slider`,
    });
    const entry = make("input", { type: "number", id, step: "any", "aria-describedby": described });
    let scale = null;

    const holds = (value) => scale.share(value) >= 0 && scale.share(value) <= 1;
    const told = (value) =>
      slider.setAttribute(
        "aria-valuetext",
        Number.isFinite(value) ? `${show(value, 4)} ${field.unit ?? ""}`.trim() : "not given",
      );

    /** The slider's place; its range is made anew for the value, or stays while somebody is at it. */
    function place(value, anew) {
      const known = Number.isFinite(value);
      if (anew || !scale) scale = row.field.scale(known ? value : 0);
      slider.value = known ? Math.round(STEPS * scale.share(value)) : 0;
      told(value);
    }

    slider.addEventListener("input", () => {
      const share = Number(slider.value) / STEPS;
      const value = field.whole ? Math.round(scale.value(share)) : scale.value(share);
      entry.value = value;
      told(value);
      commit(row, value, false);
    });
    slider.addEventListener("change", () => {
      const atEnd = [0, STEPS].includes(Number(slider.value));
      if (atEnd) place(Number(entry.value), true); // whoever comes to an end may go on
      commit(row, Number(entry.value), true);
    });
    const typed = (done) => {
      const value = entry.valueAsNumber;
      if (!Number.isFinite(value)) {
        complainAt(row, `${field.label} is empty; give a number`, true);
        return;
      }
      if (!done && value === 0) return; // more may follow, as in 0.5
      place(value, done && !(holds(value) && scale.low !== 0));
      commit(row, value, done);
    };
    entry.addEventListener("input", () => typed(false));
    entry.addEventListener("change", () => typed(true));
    row.inputs = [entry, slider];
    row.update = (state, afresh) => {
      const value = field.read(state);
      if (document.activeElement !== entry || (afresh && entry.valueAsNumber !== value)) entry.value = value ?? "";
      entry.step = field.whole ? 1 : nudge(value ?? 0);
      const busy = row.inputs.includes(document.activeElement);
      if (afresh || !scale) place(value, true);
      else if (!busy) place(value, !holds(value));
    };
    return [label, slider, make("span", { className: "entry" }, entry, unit)];
  }

  function choiceRow(row, id, described) {
    const { field } = row;
    const select = make(
      "select",
      { id, "aria-describedby": described },
      ...field.choices.map(([value, words]) => make("option", { value }, words)),
    );
    select.addEventListener("change", () => commit(row, select.value, true));
    row.inputs = [select];
    row.update = (state) => (select.value = field.read(state));
    return [make("label", { for: id }, field.label), select];
  }

  function textRow(row, id, described) {
    const { field } = row;
    const entry = make("input", { type: "text", id, spellcheck: false, "aria-describedby": described });
    entry.addEventListener("change", () => commit(row, entry.value, true));
    row.inputs = [entry];
    row.update = (state, afresh) => {
      if (document.activeElement !== entry || afresh) entry.value = field.read(state);
    };
    return [
      make("label", { for: id }, field.label, field.unit ? make("span", { className: "unit" }, ` ${field.unit}`) : ""),
      entry,
    ];
  }

  function tickRow(row, id, described) {
    const { field } = row;
    const box = make("input", { type: "checkbox", id, "aria-describedby": described });
    box.addEventListener("change", () => commit(row, box.checked, true));
    row.inputs = [box];
    row.update = (state) => (box.checked = field.read(state));
    return [make("label", { for: id, className: "tick" }, box, ` ${field.label}`)];
  }

  const kinds = { number: numberRow, choice: choiceRow, text: textRow, tick: tickRow };

  function built(field) {
    const id = slug(field);
    const row = { field };
    const help = describe(field.path);
    row.complaint = make("p", { id: `${id}-complaint`, className: "complaint", hidden: true });
    const parts = kinds[field.kind](row, id, `${id}-help ${id}-complaint`);
    row.element = make(
      "div",
      { className: `knob ${field.kind}`, title: help },
      ...parts,
      row.complaint,
      make("span", { id: `${id}-help`, hidden: true }, help),
    );
    row.element.dataset.path = field.path;
    rows.set(keyOf(field), row);
    return row.element;
  }

  function build(groups) {
    const focused = document.activeElement?.id;
    rows = new Map();
    root.replaceChildren(...groups.map((group) => {
      const details = make(
        "details",
        { open: folded.get(group.id) ?? group.open },
        make("summary", {}, make("h3", {}, group.title)),
        make("div", { className: "group" }, ...group.fields.map(built)),
      );
      details.addEventListener("toggle", () => folded.set(group.id, details.open));
      return details;
    }));
    const again = focused ? root.querySelector(`#${CSS.escape(focused)}`) : null;
    if (again instanceof HTMLElement) again.focus();
  }

  root.addEventListener("submit", (event) => event.preventDefault());
  return {
    show(groups, state, afresh) {
      const now = JSON.stringify(groups.map(({ id, title, fields }) => [id, title, fields.map(looks)]));
      if (now !== shape) {
        shape = now;
        build(groups);
        afresh = true;
      }
      for (const { fields } of groups) {
        for (const field of fields) {
          const row = rows.get(keyOf(field));
          row.field = field;
          if (afresh && row.own) complainAt(row, "");
          row.update(state, afresh);
        }
      }
    },
    complain(error) {
      for (const row of rows.values()) if (!row.own) complainAt(row, "");
      if (!error) return true;
      const parts = (error.field ?? "").split(".");
      while (parts.length) {
        const path = parts.join(".");
        const row = rows.get(path) ?? (parts.length > 1 ? rows.get(`${path}.0`) : undefined);
        if (row) {
          complainAt(row, error.message);
          row.element.closest("details").open = true;
          return true;
        }
        parts.pop();
      }
      return false;
    },
  };
}
