// Files dropped anywhere on the page, or chosen with its button: a project with the records it names, or a record.

import { request } from "./post.js";

/**
 * @param {{project: (tables: object) => void, record: (file: File) => void, complain: (error: Error) => void}} acts
 * @returns {(files: File[]) => Promise<void>} takes files
 */
export function dropped(acts) {
  async function take(files) {
    const project = files.find((file) => file.name.endsWith(".toml"));
    try {
      if (project) {
        const named = files.filter((file) => file !== project);
        const texts = await Promise.all(named.map(async (file) => [file.name, await file.text()]));
        const reply = await request("/project", { toml: await project.text(), files: Object.fromEntries(texts) });
        acts.project((await reply.json()).project);
      } else if (files.length === 1) acts.record(files[0]);
      else if (files.length) {
        const remedy = "drop a project.toml with the files it names, or one record";
        throw new Error(`${files.length} files without a project among them; ${remedy}`);
      }
    } catch (error) {
      acts.complain(error);
    }
  }

  document.addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dragging");
  });
  document.addEventListener("dragleave", (event) => event.relatedTarget || document.body.classList.remove("dragging"));
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("dragging");
    take([...event.dataTransfer.files]);
  });
  return take;
}
