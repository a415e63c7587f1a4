// What every candidate would have cost at the cursor.

import { byId, make, tableParts } from "./dom.js";
import { show } from "./scale.js";
import { command, sentence } from "./words.js";

/** So many candidates are listed, the best first. */
const LISTED = 16;

function bar(share) {
  const filled = make("span", { className: "bar" });
  filled.style.width = `${100 * share}%`;
  return filled;
}

/**
 * @param {object} thought reply to "costs"
 * @param {object} run reply to "look"
 */
export function showCosts(thought, run) {
  if (thought.error) {
    const why = sentence(thought.error.message);
    byId("costs").replaceChildren(make("p", {}, `What the commands would have cost is not known: ${why}`));
    return;
  }
  const { costs, candidates, chosen } = thought;
  const price = (i) => (Number.isFinite(costs[i]) ? costs[i] : Infinity);
  const order = [...costs.keys()].sort((a, b) => price(a) - price(b) || a - b).slice(0, LISTED);
  const most = Math.max(...[...costs].filter(Number.isFinite), 0);
  const heads = ["command", "", "predicted cost", ""];
  const rows = order.map((i) => {
    const known = Number.isFinite(costs[i]);
    return [
      command(candidates[i], run.inputs),
      known ? bar(costs[i] / (most || 1)) : "",
      known ? show(costs[i], 4) : "not allowed now",
      i === chosen ? "chosen" : "",
    ];
  });
  const left = costs.length - order.length;
  const t = `${show(thought.step * run.Ts, 5)} s`;
  const note = thought.status === "OK" ? "" : ` ${sentence(thought.remedy || thought.status)}`;
  const caption = `What each command would have cost at ${t}, at the cursor${
    left > 0 ? `; ${left} dearer ones are left out` : ""
  }.${note}`;
  byId("costs").replaceChildren(make("table", {}, ...tableParts(heads, rows, caption)));
}
