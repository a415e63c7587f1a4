// From a record of the real plant to a model: drop a CSV file, choose columns, look, use.

import { byId, make, tableParts } from "./dom.js";
import { readColumns } from "./columns.js";
import { swatch } from "./compare.js";
import { request } from "./post.js";
import { unpack } from "./wire.js";
import { recordCharts } from "./recordcharts.js";
import { show } from "./scale.js";
import { keep, kept } from "./store.js";
import { sentence } from "./words.js";

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
      "A record of your plant, one row per sample: time, what was commanded, what was measured. A few pulses are enough. It stays in this browser. Open it, or drop it anywhere on the page.",
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
    const structure = make(
      "select",
      { id: "structure", name: "structure" },
      ...[
        ["auto", "find out"],
        ["integrator", "integrator"],
        ["integrator+lag", "integrator and lag"],
        ["lag", "one lag"],
        ["lag+lag", "two lags"],
        ["pair", "oscillating pair"],
      ].map(([value, words]) => make("option", { value, selected: record.picked.structure === value }, words)),
    );
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
        speak(`identified: ${[reply.fit.structure].flat().join(", ")}; fit ${percent(reply.fit)}`);
      }
    } catch (error) {
      if (current()) complain(error);
    }
    button.removeAttribute("aria-disabled");
    button.textContent = "Identify";
  });

  function drawRecord() {
    const { reply, columns, picked } = record;
    const table = reply ? [] : readColumns(record.text, columns.rows);
    const seen = (names) => [names].flat().map((name) => table[columns.columns.indexOf(name)]);
    const { t, u, y } = reply ?? { t: seen(picked.time)[0], u: seen(picked.input), y: seen(picked.output) };
    const outputs = [picked.output].flat();
    const line = (values, colour, width = 1.2) => ({ values, colour, width });
    const parts = [
      ...outputs.map((name, q) => ({
        title: name,
        t,
        tall: true,
        lines: [line(y[q], "reference"), ...(reply ? [line(reply.model[q], "output", 1.8)] : [])],
      })),
      ...[picked.input].flat().map((name, j) => ({
        title: `${name}; time [s]`,
        t,
        lines: [{ ...line(u[j], "command"), stairs: true }],
      })),
    ];
    if (reply?.pulse_t) {
      const { pulse_t, pulse_mean, pulse_spread, pulse_model, pulse } = reply;
      parts.push(...pulse_mean.map((mean, q) => ({
        title: `${outputs[q]}, averaged over ${pulse.count} pulses; time since the command [s]`,
        t: pulse_t,
        tall: true,
        band: {
          low: mean.map((value, i) => value - pulse_spread[q][i]),
          high: mean.map((value, i) => value + pulse_spread[q][i]),
        },
        lines: [line(mean, "reference"), line(pulse_model[q], "output", 1.8)],
      })));
    }
    charts.show(parts);
    tell();
  }

  const percent = (fit) => [fit.fit_percent].flat().map((each) => `${show(each, 4)} %`).join(", ");

  function tell() {
    const { reply } = record;
    if (!reply) {
      found.replaceChildren();
      return;
    }
    const { fit } = reply;
    const rows = Object.entries(fit.parameters).map((
      [name, each],
    ) => [each.unit ? `${name} [${each.unit}]` : name, show(each.value, 5), `± ${show(each.standard_error, 2)}`]);
    const better = fit.candidates ?? [];
    const button = make("button", { type: "button", className: "main" }, "Use this model");
    button.addEventListener("click", () => use(reply));
    found.replaceChildren(
      make("h3", {}, `Found: ${[fit.structure].flat().join(", ")}`),
      make(
        "p",
        {},
        `The model explains ${percent(fit)} of what was measured. `,
        swatch("reference"),
        " measured ",
        swatch("output"),
        " model",
      ),
      make(
        "div",
        { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Parameters" },
        make("table", {}, ...tableParts(["", "value", "standard error"], rows, "Parameters of the model")),
      ),
      ...(fit.warnings.length
        ? [
          make("h3", {}, "What to look out for"),
          make("ul", { className: "warnings" }, ...fit.warnings.map((each) => make("li", {}, sentence(each)))),
        ]
        : []),
      ...(better.length > 1
        ? [
          make(
            "details",
            {},
            make("summary", {}, "Forms compared"),
            make(
              "div",
              { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Forms compared" },
              make(
                "table",
                {},
                ...tableParts(
                  ["", "criterion", "fit [%]"],
                  better.map((
                    each,
                  ) => [
                    `${each.structure}${each.chosen ? " (chosen)" : ""}`,
                    show(each.criterion, 5),
                    show(each.fit_percent, 4),
                  ]),
                  "Smaller criteria are better (Bayesian information criterion)",
                ),
              ),
            ),
          ),
        ]
        : []),
      button,
    );
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
