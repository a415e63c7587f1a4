// Requests over HTTP; what goes wrong comes back as one sentence and the field it concerns.

/** What a request was refused for. */
export class Refusal extends Error {
  /**
   * @param {string} message one sentence
   * @param {string|null} field
   */
  constructor(message, field = null) {
    super(message);
    this.field = field;
  }
}

/**
 * @param {string} path
 * @param {object|Blob|undefined} body JSON, or a file as it is; undefined: GET
 * @returns {Promise<Response>}
 * @throws {Refusal}
 */
export async function request(path, body) {
  const raw = body instanceof Blob;
  const options = body === undefined ? {} : {
    method: "POST",
    headers: { "Content-Type": raw ? "text/csv" : "application/json" },
    body: raw ? body : JSON.stringify(body),
  };
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Refusal("the server does not answer; start it again with “foreswitch page”, nothing here is lost");
  }
  if (response.ok) return response;
  const { error } = await response.json().catch(() => ({}));
  throw new Refusal(error?.message ?? `the server refuses this (${response.status})`, error?.field);
}
