// Columns of a record that the server has read without complaint: numbers between commas, semicolons, tabs or blanks.

/** More instants than this are not seen apart. */
const MOST = 5000;

/**
 * @param {string} text of the file
 * @param {number} rows how many hold numbers; a row before them names the columns
 * @returns {Float64Array[]} the columns, thinned evenly
 */
export function readColumns(text, rows) {
  const lines = text.split(/\r\n|\r|\n/).filter((line) => line.trim());
  const mark = [",", ";", "\t"].find((each) => lines[0].includes(each)) ?? /\s+/;
  const body = lines.slice(lines.length - rows);
  const step = Math.ceil(body.length / MOST);
  const cells = body.filter((_, i) => i % step === 0).map((line) => line.trim().split(mark));
  const number = (cell) => (cell?.trim() ? Number(cell) : NaN);
  return cells[0].map((_, i) => Float64Array.from(cells, (row) => number(row[i])));
}
