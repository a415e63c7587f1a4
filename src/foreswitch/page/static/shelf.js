// A dropped record stays in this browser: it is too long for an address, and the server keeps nothing.

/** @returns {Promise<IDBObjectStore>} */
function shelf(mode) {
  return new Promise((done, failed) => {
    const opening = indexedDB.open("foreswitch", 1);
    opening.onupgradeneeded = () => opening.result.createObjectStore("records");
    opening.onerror = () => failed(opening.error);
    opening.onsuccess = () => done(opening.result.transaction("records", mode).objectStore("records"));
  });
}

/**
 * Keeps a value; without storage (a private window) it lasts until the page is left.
 * @param {string} key
 * @param {any} value
 * @returns {Promise<void>}
 */
export async function keep(key, value) {
  const place = await shelf("readwrite").catch(() => null);
  place?.put(value, key);
}

/**
 * @param {string} key
 * @returns {Promise<any>} undefined where nothing was kept
 */
export async function kept(key) {
  const place = await shelf("readonly").catch(() => null);
  if (!place) return undefined;
  return new Promise((done) => {
    const asked = place.get(key);
    asked.onsuccess = () => done(asked.result);
    asked.onerror = () => done(undefined);
  });
}
