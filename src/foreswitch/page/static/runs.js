// The run of the settings: asked for at once, its costs, proof and company once the settings rest. What is seen stays
// that of the last settings that worked, its proof with it.

import { showCosts } from "./costs.js";
import { asked, key } from "./settings.js";
import { speak } from "./telling.js";
import { summary } from "./words.js";

/** What waits until the settings rest so long [ms]: the picture comes first. */
const REST = { costs: 80, proof: 120, search: 500 };
/** Measured times from a slider to the picture that are kept, for whoever wants to see them. */
const TIMES = 500;

/** Notes the time from an event to the picture it led to, once that is painted. */
function painted(begun) {
  const name = "slider to picture";
  requestAnimationFrame(() => {
    const channel = new MessageChannel();
    channel.port1.onmessage = () => {
      if (performance.getEntriesByName(name).length >= TIMES) performance.clearMeasures(name);
      performance.measure(name, { start: begun });
    };
    channel.port2.postMessage(null);
  });
}

/**
 * @param {import("./store.js").Store} store
 * @param {{ask: Function}} server
 * @param {object} drawing see picture.js
 * @param {object} readout see readout.js
 * @param {{trouble: (error: object|null) => void, beside: () => void}} acts beside: asks for what stands beside the run
 * @returns {{anew: (begun?: number) => void, rest: () => void, think: () => void}}
 */
export function runs(store, server, drawing, readout, { trouble, beside }) {
  const change = store.own("last", "refused", "proof", "early");
  let rests = []; // timers of the slow questions
  let thinking = 0; // timer of the costs

  const present = () => key(store.now().settings);

  function look(begun) {
    const mine = asked(store.now().settings);
    server.ask("look", "", mine, (reply) => {
      const current = key(mine) === present();
      if (!reply.error) seen(mine, reply, current, begun);
      else if (current) refuse(reply.error);
    });
  }

  function seen(mine, run, current, begun) {
    const { settings, dragging, last, early } = store.now();
    trouble(null);
    const known = last.key === key(mine)
      ? last
      : { key: key(mine), settings: mine, proof: current ? early : undefined };
    change({ refused: "", last: { ...known, run } });
    drawing.show(run, settings.view.step, dragging);
    if (current && known.proof) proved(known.proof); // it may have come first
    readout.run();
    if (begun !== undefined) painted(begun);
    if (!dragging && current) speak(summary(run));
    clearTimeout(thinking);
    thinking = setTimeout(think, dragging ? REST.costs : 0);
  }

  function refuse(error) {
    change({ refused: present() });
    const { last } = store.now();
    trouble(error);
    proved(last.proof);
    if (last.run && !last.proof) prove(last.settings);
    wait([beside, REST.search]);
  }

  function think() {
    const { settings, run } = store.now().last;
    if (!run) return;
    server.ask("costs", "", { ...settings, step: drawing.step() }, (reply) => {
      if (run !== store.now().last.run) return;
      drawing.thought(reply.error ? null : reply);
      showCosts(reply, run);
    });
  }

  function prove(mine) {
    server.ask("certify", "", mine, (reply) => {
      const { last, refused } = store.now();
      if (key(mine) === refused) return;
      const found = reply.error ? { holds: false, reasons: [reply.error.message] } : reply;
      const ofLast = key(mine) === last.key;
      if (ofLast) change({ last: { ...last, proof: found } });
      else if (key(mine) === present()) change({ early: found });
      if (ofLast && [key(mine), refused].includes(present())) proved(found);
    });
  }

  function proved(found) {
    change({ proof: found });
    drawing.band(found?.holds && found.low ? { ...found, fresh: !found.covers } : null);
    readout.proof();
  }

  /** Does things later, unless the settings change before; what waited before is dropped. */
  function wait(...things) {
    for (const timer of rests) clearTimeout(timer);
    rests = things.map(([thing, time]) => setTimeout(thing, time));
  }

  return {
    /** For changed settings, at once. */
    anew(begun) {
      change({ proof: undefined, early: undefined });
      drawing.dim();
      readout.looking();
      look(begun);
    },
    /** For changed settings, once they rest. */
    rest: () => wait([() => prove(asked(store.now().settings)), REST.proof], [beside, REST.search]),
    think,
  };
}
