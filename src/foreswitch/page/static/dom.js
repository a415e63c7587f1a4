// Elements, made in one call.

/**
 * @param {string} tag
 * @param {Record<string, any>} [properties] attributes where the name has a dash or is "for", "role" or "scope"
 * @param {...(Node|string)} children
 * @returns {any} the element; which kind, the tag says
 */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.includes("-") || ["for", "role", "scope"].includes(name)) element.setAttribute(name, value);
    else element[name] = value;
  }
  element.append(...children);
  return element;
}

/** @type {(id: string) => any} */
export const byId = (id) => document.getElementById(id);

/**
 * A table with a head; the first cell of each row names it.
 * @param {string[]} heads may be empty
 * @param {(string|Node)[][]} rows
 * @param {string} caption
 * @returns {Node[]} what goes into a table element
 */
export function tableParts(heads, rows, caption) {
  const head = heads.map((each) => (each ? make("th", { scope: "col" }, each) : make("td")));
  const body = rows.map(([name, ...cells]) =>
    make("tr", {}, make("th", { scope: "row" }, name), ...cells.map((each) => make("td", {}, each)))
  );
  return [
    make("caption", {}, caption),
    make("thead", {}, make("tr", {}, ...head)),
    make("tbody", {}, ...body),
  ];
}
