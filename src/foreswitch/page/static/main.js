// The page. Data goes round one way; the walk of a slider to the picture:
//
//   knobs.js    a slider's place becomes a number, which its field of fields.js writes into a copy of the settings
//   main.js     become: the settings go into the store, the fields and the address
//   runs.js     asks for their run
//   wire.js     sends the newest question, takes the reply apart
//   runs.js     puts the run into the store
//   picture.js  draws it
//
// Once the settings rest, runs.js asks for costs and proof and beside.js for the runs beside it; readout.js tells all
// of it in words and figures. This file makes the parts, joins them and owns the settings.

import { address } from "./address.js";
import { asksBeside } from "./beside.js";
import { comparePanel } from "./compare.js";
import { byId, make } from "./dom.js";
import { dropped } from "./drop.js";
import { exportsPanel } from "./exports.js";
import { groups, meaning } from "./fields.js";
import { identifyPanel } from "./identify.js";
import { knobs } from "./knobs.js";
import { picture } from "./picture.js";
import { request } from "./post.js";
import { readout } from "./readout.js";
import { runs } from "./runs.js";
import { asked, damaged, flaw, fresh, key, whole } from "./settings.js";
import { store } from "./store.js";
import { tabs } from "./tabs.js";
import { noticing, speak, tellTrouble } from "./telling.js";
import { themeSwitch } from "./themeswitch.js";
import { wire } from "./wire.js";
import { sentence, summary } from "./words.js";

const start = await (await request("/start.json")).json();
const page = store(start.project);
const change = page.own("settings", "dragging");
const notice = noticing(page);
const settings = () => page.now().settings;

// Changing ------------------------------------------------------------------------------------------------------------

/**
 * Takes over other settings.
 * @param {import("./settings.js").Settings} next
 * @param {object} [how]
 * @param {string} [how.what] names the change, so that the back button undoes it as one
 * @param {number} [how.begun] time of the event that led to it
 * @param {boolean} [how.dragged] by a slider still held
 * @param {boolean} [how.afresh] the fields show it even where somebody is typing
 */
function become(next, { what = "", begun, dragged = false, afresh = false } = {}) {
  const { settings: before, dragging, last } = page.now();
  const differs = key(next) !== key(before);
  change({ settings: next, dragging: dragged });
  fields.show(groups(next), next, afresh);
  links.note(next, what);
  if (differs || !last.run) asking.anew(begun);
  else if (dragging && !dragged) {
    drawing.show(last.run, next.view.step, false);
    if (last.key === key(next)) speak(summary(last.run)); // else once it is there
  }
  if (!differs && page.now().proof !== undefined) {
    askBeside();
    return;
  }
  asking.rest();
  if (next.view.baselines.length) told.overlays(); // those of the settings before are marked
  else told.legend();
}

/** Takes over another view of the same settings. */
function view(changed, what) {
  become({ ...settings(), view: { ...settings().view, ...changed } }, { what });
}

/** Takes over the project of a file or an example. */
function loaded(project, what) {
  const found = flaw(project);
  notice("file", found);
  if (found) return;
  notice("link", "");
  become({ ...fresh(project), view: { ...settings().view, step: null } }, { what, afresh: true });
}

/** Takes over the project drafted for a plant that was found. */
function used({ project, fit }) {
  openTab("tune");
  byId("tab-tune").focus();
  loaded(project, "model");
  speak(`the model ${[fit.structure].flat().join(", ")} is used`);
}

// Joining -------------------------------------------------------------------------------------------------------------

const explain = (path) => meaning(path, start.schema);

const fields = knobs(byId("knobs"), (write, { path, done }) => {
  const begun = performance.now();
  become(write(settings()), { what: path, begun, dragged: !done });
}, explain);

const links = address(
  (linked) => {
    if (damaged(linked)) {
      notice("link", "This link is damaged; the settings before it are kept.");
      links.note(settings(), "");
    } else become(whole(linked), { afresh: true });
  },
  (long) =>
    notice("long", long ? "These settings are too long for an address; save the project file to keep them." : ""),
);

const server = wire(start.limits.message, ({ open, wait }) => {
  const again = `The server does not answer; trying again in ${Math.ceil(wait / 1000)} s. Nothing is lost.`;
  notice("server", open ? "" : again);
});

const drawing = picture((step) => {
  change({ settings: { ...settings(), view: { ...settings().view, step } } });
  links.note(settings(), "cursor");
  asking.think();
});

const comparing = comparePanel({
  pin(name) {
    const { pins } = settings().view;
    const label = name || `run ${pins.length + 1}`;
    view({ pins: [...pins, { name: label, ...asked(settings()) }] }, `pin ${pins.length}`);
    askBeside();
    speak(`${label} is pinned`);
  },
  unpin(i) {
    view({ pins: settings().view.pins.filter((_, j) => j !== i) }, `unpin ${i}`);
  },
  use(i) {
    become({ ...settings(), ...asked(settings().view.pins[i]) }, { what: `use ${i}`, afresh: true });
  },
  toggle(which, on) {
    const { baselines } = settings().view;
    view({ baselines: on ? [...baselines, which] : baselines.filter((each) => each !== which) }, which);
  },
});

const told = readout(page, drawing, comparing);
const askBeside = asksBeside(page, server, told);
const asking = runs(page, server, drawing, told, {
  beside: askBeside,
  trouble: (error) => tellTrouble(error, fields.complain, Boolean(page.now().last.run)),
});

const identifying = identifyPanel({ use: used, speak });
exportsPanel(settings, speak);

const openTab = tabs((id) => {
  byId("run").hidden = id === "identify";
  byId("read").hidden = id === "identify"; // it is about the run
  byId("record-picture").hidden = id !== "identify";
});

const take = dropped({
  project: (project) => loaded(project, "opened"),
  record(file) {
    openTab("identify");
    identifying.load(file);
  },
  complain: (error) => notice("file", sentence(error.message)),
});
const chosen = byId("open");
chosen.addEventListener("change", () => {
  take([...chosen.files]);
  chosen.value = "";
});

const presets = byId("presets");
presets.append(
  make("option", { value: "" }, "choose …"),
  ...start.presets.map((each) => make("option", { value: each.name, title: each.about ?? "" }, each.title)),
);
presets.addEventListener("change", () => {
  const preset = start.presets.find((each) => each.name === presets.value);
  if (preset) loaded(preset.project, `preset ${preset.name}`);
});

themeSwitch(() => {
  drawing.restyle();
  identifying.restyle();
});

/** What a setting means, for the field in focus or under the pointer. */
function help(event) {
  const row = event.target.closest?.("[data-path]");
  byId("help").textContent = row ? explain(row.dataset.path) : "";
}
document.addEventListener("focusin", help);
document.addEventListener("pointerover", help);

byId("skip").addEventListener("click", (event) => {
  event.preventDefault(); // the address holds the settings
  byId("panel").focus();
});

// Beginning -----------------------------------------------------------------------------------------------------------

const linked = await links.read();
const sound = linked && !damaged(linked);
if (linked !== undefined && !sound) notice("link", "This link is damaged; here is what the server began with instead.");
become(sound ? whole(linked) : settings(), { afresh: true });
identifying.restore();
