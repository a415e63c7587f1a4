// The page: one state, shown in fields and picture, asked of the server, kept in the address.

import { address } from "./address.js";
import { DASHES, otherColour } from "./colours.js";
import { BASELINES, comparePanel, swatch } from "./compare.js";
import { showCosts } from "./costs.js";
import { byId, make, tableParts } from "./dom.js";
import { dropped } from "./drop.js";
import { exportsPanel } from "./exports.js";
import { groups, meaning } from "./fields.js";
import { identifyPanel } from "./identify.js";
import { knobs } from "./knobs.js";
import { picture } from "./picture.js";
import { request } from "./post.js";
import { lacking } from "./sizes.js";
import { tabs } from "./tabs.js";
import { themeSwitch } from "./themeswitch.js";
import { figures, HEADS, sentence, summary, verdict } from "./words.js";
import { wire } from "./wire.js";

/** What waits until the settings rest so long [ms]: the picture comes first. */
const REST = { costs: 80, proof: 120, search: 500 };
/** Measured times from a slider to the picture that are kept, for whoever wants to see them. */
const TIMES = 500;

const start = await (await request("/start.json")).json();
const fresh = (project) => ({ v: 1, project, options: {}, view: { pins: [], baselines: [], step: null } });

let state = fresh(start.project);
let run = null; // the last run that could be made
let proof; // of the present settings, once their run is shown; undefined: not there yet
let early; // one that came before its run
let good = { key: "", settings: null, proof: undefined }; // of that run
let refused = ""; // settings of which no run can be made
let rests = []; // timers of the slow questions
let thinking = 0; // timer of the costs
let dragging = false;
const beside = new Map(); // lane -> {key, run, proof, error}: pinned runs and baselines

const asked = ({ project, options }) => ({ project, options });
const key = (each) => JSON.stringify([each.project, each.options]);
/** Settings of what is shown beside the run: the present ones, or where no run can be made of them those before. */
const meant = () => (refused === key(state) && run ? good.settings : asked(state));
const numbers = new Map(); // of pinned settings, for the names of their lanes
const laneOf = (pin) => {
  if (!numbers.has(key(pin))) numbers.set(key(pin), numbers.size);
  return `pin ${numbers.get(key(pin))}`;
};

// Telling --------------------------------------------------------------------------------------------------------------

function speak(text) {
  byId("spoken").textContent = text;
}

/** One sentence for each matter: the server, a file, a link. */
const notices = new Map();
function notice(matter, text) {
  if ((notices.get(matter) ?? "") === text) return; // not spoken again
  notices.set(matter, text);
  byId("notice").textContent = [...notices.values()].filter(Boolean).join(" ");
  byId("notice").hidden = !byId("notice").textContent;
}

function trouble(error) {
  const shown = fields.complain(error);
  const line = byId("trouble");
  line.hidden = !error;
  line.textContent = error
    ? `${sentence(error.message)}${run ? " The picture is of the last settings that worked." : ""}`
    : "";
  document.body.classList.toggle("old", Boolean(error));
  if (error) speak(shown ? `${error.message}` : line.textContent);
}

// Asking ---------------------------------------------------------------------------------------------------------------

function look(begun) {
  const mine = asked(state);
  server.ask("look", "", mine, (reply) => {
    if (reply.error) {
      if (key(mine) === key(state)) refuse(reply.error);
      return;
    }
    trouble(null);
    refused = "";
    const current = key(mine) === key(state);
    if (good.key !== key(mine)) good = { key: key(mine), settings: mine, proof: current ? early : undefined };
    run = reply;
    drawing.show(run, state.view.step, dragging);
    if (current && good.proof) proved(good.proof); // it may have come first
    byId("summary").textContent = summary(run);
    table();
    if (begun !== undefined) painted(begun);
    if (!dragging && current) speak(summary(run));
    clearTimeout(thinking);
    thinking = setTimeout(think, dragging ? REST.costs : 0);
  });
}

/** What is seen stays that of the last settings that worked, its proof with it. */
function refuse(error) {
  refused = key(state);
  for (const timer of rests) clearTimeout(timer);
  trouble(error);
  proved(good.proof);
  if (run && !good.proof) prove(good.settings);
  rests = [setTimeout(others, REST.search)];
}

/** Notes the time from an event to the picture it led to, once that is painted. */
function painted(begun) {
  requestAnimationFrame(() => {
    const channel = new MessageChannel();
    channel.port1.onmessage = () => {
      if (performance.getEntriesByName("slider to picture").length >= TIMES) {
        performance.clearMeasures("slider to picture");
      }
      performance.measure("slider to picture", { start: begun });
    };
    channel.port2.postMessage(null);
  });
}

function think() {
  if (!run) return;
  const of = run;
  server.ask("costs", "", { ...good.settings, step: drawing.step() }, (reply) => {
    if (of !== run) return;
    drawing.thought(reply.error ? null : reply);
    showCosts(reply, run);
  });
}

function prove(mine = asked(state)) {
  server.ask("certify", "", mine, (reply) => {
    if (key(mine) === refused) return;
    const found = reply.error ? { holds: false, reasons: [reply.error.message] } : reply;
    const seen = key(mine) === good.key;
    if (seen) good.proof = found;
    else if (key(mine) === key(state)) early = found;
    if (seen && [key(mine), refused].includes(key(state))) proved(found);
  });
}

function proved(found) {
  proof = found;
  drawing.band(found?.holds && found.low ? { ...found, fresh: !found.covers } : null);
  byId("proof").textContent = run && found ? verdict(found, run.outputs) : "";
  legend();
  table();
}

/** Pinned runs and baselines that are shown but not there yet. */
function others() {
  const wanted = new Map(state.view.pins.map((pin) => [laneOf(pin), { kind: "look", ...asked(pin) }]));
  for (const which of state.view.baselines) wanted.set(which, { kind: "baseline", which, ...meant() });
  for (const lane of beside.keys()) if (!wanted.has(lane)) beside.delete(lane);
  for (const [lane, { kind, ...body }] of wanted) {
    const mine = key(body);
    const held = beside.get(lane);
    if (held?.key === mine) continue;
    beside.set(lane, { ...held, error: undefined, key: mine, waiting: true });
    const current = () => beside.get(lane)?.key === mine;
    server.ask(kind, lane, body, (reply) => {
      if (!current()) return;
      beside.set(lane, {
        key: mine,
        proof: beside.get(lane).proof,
        ...(reply.error ? { error: reply.error } : { run: reply }),
      });
      overlays();
    });
    if (kind === "look") {
      server.ask("certify", lane, body, (reply) => {
        if (!current()) return;
        beside.set(lane, { ...beside.get(lane), proof: reply.error ? { holds: false } : reply });
        table();
      });
    }
  }
  overlays();
}

/** Runs beside the present one, in their order, with the number of their colour. */
function drawn() {
  const pins = state.view.pins.map((pin, i) => ({ label: pin.name, lane: laneOf(pin), colour: i }));
  const laws = BASELINES.filter(([which]) => state.view.baselines.includes(which))
    .map(([which, words]) => ({
      label: words,
      lane: which,
      colour: state.view.pins.length + BASELINES.findIndex(([each]) => each === which),
      law: true,
    }));
  const present = key(meant());
  return [...pins, ...laws].map((each) => {
    const held = beside.get(each.lane);
    const waiting = Boolean(held?.waiting || (each.law && held && held.key !== present));
    return { ...each, ...held, waiting, label: waiting && each.law ? `${each.label} (being tuned …)` : each.label };
  });
}

function overlays() {
  const there = drawn();
  const alike = (each) => each.run && run && String(each.run.outputs) === String(run.outputs);
  drawing.overlay(
    there.filter(alike).map((each) => ({ t: each.run.t, y: each.run.y, colour: each.colour, fresh: !each.waiting })),
  );
  comparing.show(
    state.view,
    Object.fromEntries(
      there.filter((each) => each.law).map((
        each,
      ) => [
        each.lane,
        each.waiting ? {} : { error: each.error, parameters: each.run?.parameters, outputs: each.run?.outputs },
      ]),
    ),
  );
  legend();
  table();
}

function legend() {
  const item = (mark, text) => make("li", {}, mark, text);
  const lines = [item(swatch("output"), "output"), item(swatch("reference", [6, 4]), "reference")];
  if (drawing.banded()) {
    lines.push(item(
      make("span", { className: "swatch area" }),
      !proof ? "proven band, of the settings before" : proof.covers ? "proven band, of the model alone" : "proven band",
    ));
  }
  for (const each of drawn()) {
    if (each.run) lines.push(item(swatch(otherColour(each.colour), DASHES[each.colour % 4]), each.label));
  }
  byId("legend").replaceChildren(...lines);
}

function table() {
  if (!run) return;
  const { outputs } = run;
  const rows = [["this run", ...figures(run.metrics, outputs, proof)]];
  for (const each of drawn()) {
    if (each.run) {
      rows.push([each.label, ...figures(each.run.metrics, each.run.outputs, each.law ? null : each.proof)]);
    }
  }
  byId("figures").replaceChildren(
    ...tableParts(HEADS, rows, "Figures of merit; several outputs or inputs in their order"),
  );
}

// Changing -------------------------------------------------------------------------------------------------------------

/** Takes over another state; `what` names the change, so that the back button undoes it as one. */
function become(next, { what = "", begun, dragged = false, afresh = false } = {}) {
  const differs = key(next) !== key(state);
  const letGo = dragging && !dragged;
  state = next;
  dragging = dragged;
  fields.show(groups(state), state, afresh);
  links.note(state, what);
  if (differs || !run) {
    proof = early = undefined;
    drawing.dim();
    byId("proof").textContent = "Looking for a proof …";
    look(begun);
  } else if (letGo) {
    drawing.show(run, state.view.step, false);
    if (good.key === key(state)) speak(summary(run)); // else once it is there
  }
  if (!differs && proof !== undefined) {
    others();
    return;
  }
  for (const timer of rests) clearTimeout(timer);
  rests = [setTimeout(() => prove(), REST.proof), setTimeout(others, REST.search)];
  if (state.view.baselines.length) overlays(); // those of the settings before are marked
  else legend();
}

/** Why a project cannot even be shown; other mistakes are told beside their fields. */
function flaw(project) {
  const table = lacking(project);
  if (table) return `The file has no table [${table}]; add it.`;
  try {
    groups(fresh(project));
  } catch {
    return "The file holds lists or tables where others belong; “foreswitch simulate” says which.";
  }
  return "";
}

function loaded(project, what) {
  const found = flaw(project);
  if (found) {
    notice("file", found);
    return;
  }
  notice("file", "");
  notice("link", "");
  become({ ...fresh(project), view: { ...state.view, step: null } }, { what, afresh: true });
}

/** The project drafted for a plant that was found. */
function used({ project, fit }) {
  opened("tune");
  byId("tab-tune").focus();
  loaded(project, "model");
  speak(`the model ${[fit.structure].flat().join(", ")} is used`);
}

const fields = knobs(byId("knobs"), (change, { path, done }) => {
  const begun = performance.now();
  become(change(state), { what: path, begun, dragged: !done });
}, (path) => meaning(path, start.schema));

const drawing = picture((step, done) => {
  state = { ...state, view: { ...state.view, step } };
  links.note(state, "cursor");
  think();
});

const comparing = comparePanel({
  pin(name) {
    const label = name || `run ${state.view.pins.length + 1}`;
    become({ ...state, view: { ...state.view, pins: [...state.view.pins, { name: label, ...asked(state) }] } }, {
      what: `pin ${state.view.pins.length}`,
    });
    others();
    speak(`${label} is pinned`);
  },
  unpin(i) {
    become({ ...state, view: { ...state.view, pins: state.view.pins.filter((_, j) => j !== i) } }, {
      what: `unpin ${i}`,
    });
  },
  use(i) {
    const { project, options } = state.view.pins[i];
    become({ ...state, project, options }, { what: `use ${i}`, afresh: true });
  },
  toggle(which, on) {
    const baselines = on ? [...state.view.baselines, which] : state.view.baselines.filter((each) => each !== which);
    become({ ...state, view: { ...state.view, baselines } }, { what: which });
  },
});

const identifying = identifyPanel({ use: used, speak });
exportsPanel(() => state, speak);

const shown = tabs((id) => {
  byId("run").hidden = id === "identify";
  byId("read").hidden = id === "identify"; // it is about the run
  byId("record-picture").hidden = id !== "identify";
});
const opened = (id) => shown(id);

const take = dropped({
  project: (project) => loaded(project, "opened"),
  record(file) {
    opened("identify");
    identifying.load(file);
  },
  complain: (error) => notice("file", sentence(error.message)),
});
byId("open").addEventListener("change", (event) => {
  take([...event.target.files]);
  event.target.value = "";
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

// What a setting means, for the field in focus or under the pointer
const tell = (event) => {
  const row = event.target.closest?.("[data-path]");
  byId("help").textContent = row ? meaning(row.dataset.path, start.schema) : "";
};
document.addEventListener("focusin", tell);
document.addEventListener("pointerover", tell);

byId("skip").addEventListener("click", (event) => {
  event.preventDefault(); // the address holds the settings
  byId("panel").focus();
});

// Beginning ------------------------------------------------------------------------------------------------------------

const links = address(
  (next) => {
    if (damaged(next)) {
      notice("link", "This link is damaged; the settings before it are kept.");
      links.note(state, "");
      return;
    }
    become(whole(next), { afresh: true });
  },
  (long) =>
    notice("long", long ? "These settings are too long for an address; save the project file to keep them." : ""),
);

/** Whether nothing can be shown of a link. */
function damaged(next) {
  return !next || [next, ...(next.view?.pins ?? [])].some((each) => flaw(each.project));
}

/** With everything that a link made by hand may leave out. */
function whole(next) {
  const empty = fresh(next.project);
  return { ...empty, ...next, options: next.options ?? {}, view: { ...empty.view, ...next.view } };
}

const server = wire(start.limits.message, ({ open, wait }) => {
  notice(
    "server",
    open ? "" : `The server does not answer; trying again in ${Math.ceil(wait / 1000)} s. Nothing is lost.`,
  );
});

const linked = await links.read();
const sound = linked && !damaged(linked);
if (linked !== undefined && !sound) notice("link", "This link is damaged; here is what the server began with instead.");
become(sound ? whole(linked) : state, { afresh: true });
identifying.restore();
