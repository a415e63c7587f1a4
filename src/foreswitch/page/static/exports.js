// Files made of the present settings.

import { byId, make } from "./dom.js";
import { request } from "./post.js";
import { sentence } from "./words.js";

const FILES = [
  ["project.toml", "Project file", "Everything set here, for the command line and for this page."],
  ["report.html", "Report", "The run on one page: picture, figures, controller and plant."],
  ["firmware.zip", "C sources", "The controller for your microcontroller, with a self-test."],
  ["controller.fmu", "FMU", "The controller for Simulink, Modelica and others."],
];

/**
 * Hands bytes to the browser's downloads.
 * @param {Blob} blob
 * @param {string} name
 */
function save(blob, name) {
  const link = make("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/**
 * @param {() => object} current state
 * @param {(text: string) => void} speak
 */
export function exportsPanel(current, speak) {
  byId("export").replaceChildren(
    make("p", {}, "Files of the settings as they are now."),
    ...FILES.map(([name, title, about]) => {
      const complaint = make("p", {
        className: "complaint",
        id: `export-${name.split(".")[0]}-complaint`,
        hidden: true,
      });
      const button = make("button", { type: "button", "aria-describedby": complaint.id }, `Save ${name}`);
      button.addEventListener("click", async () => {
        if (button.getAttribute("aria-disabled")) return; // not "disabled", which would take the focus away
        button.setAttribute("aria-disabled", "true");
        complaint.hidden = true;
        try {
          const { project, options } = current();
          save(await (await request(`/export/${name}`, { project, options })).blob(), name);
          speak(`${name} is saved`);
        } catch (error) {
          complaint.textContent = sentence(error.message);
          complaint.hidden = false;
        }
        button.removeAttribute("aria-disabled");
      });
      return make("div", { className: "offer" }, make("h3", {}, title), make("p", {}, about), button, complaint);
    }),
    make("p", {}, "The address in the address bar holds all of it too: copy it to share or keep these settings."),
  );
}
