// From a record of the real plant to a model: drop a CSV file, choose columns, look, use.

import { byId, make } from "./dom.js";
import { explained, foundModel, recordParts } from "./found.js";
import { request } from "./post.js";
import { unpack } from "./wire.js";
import { recordCharts } from "./recordcharts.js";
import { keep, kept } from "./shelf.js";
import { sentence } from "./words.js";

const STRUCTURES = [
  ["auto", "find out"],
  ["integrator", "integrator"],
  ["integrator+lag", "integrator and lag"],
  ["lag", "one lag"],
  ["lag+lag", "two lags"],
  ["pair", "oscillating pair"],
];

/**
 * @param {{use: (found: object) => void, speak: (text: string) => void}} acts
 * @returns {{load: (file: File) => Promise<void>, restyle: () => void, restore: () => Promise<void>}}
 */
export function identifyPanel({ use, speak }) {
  const charts = recordCharts(byId("record-picture"));
  const file = make("input", { type: "file", accept: ".csv,.txt,text/csv", "aria-label": "Open a record, a CSV file" });
  const complaint = make("p", { className: "complaint", id: "record-complaint", hidden: true });
  const chosen = make("form", { id: "columns", hidden: true });
  const found = make("div", { id: "found" });
  let record = null; // {name, text, columns, picked: {time, input, output, structure}, reply}

  file.addEventListener("change", () => file.files[0] && load(file.files[0]));
  byId("identify").append(
    make(
      "p",
      {},
      "A record of your plant, one row per sample: time, what was commanded, what was measured. A few pulses are " +
        "enough. It stays in this browser. Open it, or drop it anywhere on the page.",
    ),
    make("label", { className: "button file" }, "Open a record", file),
    complaint,
    chosen,
    found,
  );

  function complain(error) {
    complaint.textContent = error ? sentence(error.message) : "";
    complaint.hidden = !error;
    for (const select of chosen.querySelectorAll("select")) {
      const concerned = error && error.field && select.name === error.field;
      if (concerned) select.setAttribute("aria-invalid", "true");
      else select.removeAttribute("aria-invalid");
    }
  }

  async function load(given) {
    try {
      const text = await given.text();
      const columns = await (await request("/columns", new Blob([text]))).json();
      const { time, input, output } = columns.guess;
      record = {
        name: given.name,
        text,
        columns,
        picked: { time, input: [input].flat(), output: [output].flat(), structure: "auto" },
        reply: null,
      };
      complain(null);
      choose();
      remember();
    } catch (error) {
      complain(error);
    }
  }

  const remember = () => keep("record", record);

  function columnChoice(name, label, several) {
    const id = `column-${name}`;
    const { columns, picked } = record;
    const select = make(
      "select",
      { id, name, multiple: several && columns.columns.length > 3, "aria-describedby": "record-complaint" },
      ...columns.columns.map((each) =>
        make("option", { value: each, selected: [picked[name]].flat().includes(each) }, each)
      ),
    );
    select.addEventListener("change", () => {
      const values = [...select.selectedOptions].map((each) => each.value);
      picked[name] = several ? values : values[0];
      record.reply = null;
      drawRecord();
      remember();
    });
    return [make("label", { for: id }, label), select];
  }

  function choose() {
    const { picked } = record;
    const options = STRUCTURES.map(([value, words]) =>
      make("option", { value, selected: picked.structure === value }, words)
    );
    const structure = make("select", { id: "structure", name: "structure" }, ...options);
    structure.addEventListener("change", () => (record.picked.structure = structure.value));
    chosen.hidden = false;
    chosen.replaceChildren(
      make("p", {}, `${record.name}: ${record.columns.rows} rows.`),
      make(
        "div",
        { className: "grid2" },
        ...columnChoice("time", "Time", false),
        ...columnChoice("input", "Command", true),
        ...columnChoice("output", "Measurement", true),
        make("label", { for: "structure" }, "Form of the model"),
        structure,
      ),
      make("button", { type: "submit" }, "Identify"),
    );
    drawRecord();
  }

  chosen.addEventListener("submit", async (event) => {
    event.preventDefault();
    const button = chosen.querySelector("button");
    if (button.getAttribute("aria-disabled")) return; // not "disabled", which would take the focus away
    button.setAttribute("aria-disabled", "true");
    button.textContent = "Identifying …";
    const asked = record;
    const wanted = JSON.stringify(asked.picked);
    const current = () => asked === record && JSON.stringify(record.picked) === wanted;
    try {
      const { structure, ...picked } = asked.picked;
      const query = new URLSearchParams({ structure }); // columns by number, so that their names may be anything
      for (const [key, names] of Object.entries(picked)) {
        for (const name of [names].flat()) query.append(key, asked.columns.columns.indexOf(name) + 1);
      }
      const reply = unpack(await (await request(`/identify?${query}`, new Blob([asked.text]))).arrayBuffer());
      if (current()) {
        record.reply = reply;
        complain(null);
        drawRecord();
        remember();
        speak(`identified: ${[reply.fit.structure].flat().join(", ")}; fit ${explained(reply.fit)}`);
      }
    } catch (error) {
      if (current()) complain(error);
    }
    button.removeAttribute("aria-disabled");
    button.textContent = "Identify";
  });

  function drawRecord() {
    charts.show(recordParts(record));
    found.replaceChildren(...(record.reply ? foundModel(record.reply, use) : []));
  }

  return {
    load,
    restyle: () => record && drawRecord(),
    async restore() {
      record ??= (await kept("record")) ?? null;
      if (record) choose();
    },
  };
}
