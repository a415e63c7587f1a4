// One WebSocket: requests out, replies in. In each lane one request is under way and the newest waits, so that
// nothing queues while a slider is dragged; after a broken connection what was under way is asked again. What takes
// seconds is sent at once: the server leaves out what is out of date, and only the newest reply counts.

/** Waits between attempts to connect: from the first to the longest [ms]. */
const FIRST = 250;
const LONGEST = 8000;
const SLOW = ["certify", "baseline"];

/**
 * Header and arrays of one binary message.
 * @param {ArrayBuffer} message
 * @returns {object} the header, its arrays as Float32Arrays or lists of them, one per row
 */
export function unpack(message) {
  const length = new DataView(message).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(message, 4, length)));
  const numbers = new Float32Array(message, 4 + length);
  for (const [name, [offset, shape]] of Object.entries(header.arrays ?? {})) {
    const row = (i, length) => numbers.subarray(offset + i * length, offset + (i + 1) * length);
    const [count, length] = shape;
    header[name] = shape.length > 1 ? Array.from({ length: count }, (_, i) => row(i, length)) : row(0, count);
  }
  delete header.arrays;
  return header;
}

/**
 * @param {number} limit of a message [bytes]; a longer one would end the connection
 * @param {(state: {open: boolean, wait: number}) => void} noticed a connection lost, with the wait [ms], or found
 * @returns {{ask: (kind: string, lane: string, body: object, answered: (reply: object) => void) => void}}
 */
export function wire(limit, noticed) {
  const lanes = new Map(); // kind and lane -> {slow, sent, next}, each {id, text, answered}
  let socket = null;
  let wait = FIRST;
  let number = 0;

  const open = () => socket?.readyState === WebSocket.OPEN;

  function send(lane) {
    if (!open() || !lane.next || (lane.sent && !lane.slow)) return;
    lane.sent = lane.next;
    lane.next = null;
    socket.send(lane.sent.text);
  }

  function received(event) {
    wait = FIRST;
    const reply = unpack(event.data);
    const lane = [...lanes.values()].find((each) => each.sent?.id === reply.id);
    if (!lane) return;
    const { answered } = lane.sent;
    lane.sent = null;
    if (!reply.stale) answered(reply);
    send(lane);
  }

  function lost() {
    for (const lane of lanes.values()) {
      lane.next ??= lane.sent;
      lane.sent = null;
    }
    noticed({ open: false, wait });
    setTimeout(connect, wait);
    wait = Math.min(2 * wait, LONGEST);
  }

  function connect() {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = received;
    socket.onclose = lost;
    socket.onopen = () => {
      noticed({ open: true, wait: 0 });
      for (const lane of lanes.values()) send(lane);
    };
  }

  connect();
  return {
    ask(kind, name, body, answered) {
      const key = `${kind} ${name}`;
      const lane = lanes.get(key) ?? { slow: SLOW.includes(kind), sent: null, next: null };
      lanes.set(key, lane);
      const id = ++number;
      const text = JSON.stringify({ id, kind, lane: name, ...body });
      if (new Blob([text]).size > limit) {
        lane.sent = lane.next = null; // what was asked before is out of date
        const message = `The settings are larger than the ${
          Math.floor(limit / 1024)
        } KiB that the server reads at once; shorten their lists`;
        setTimeout(() => answered({ id, kind, error: { message, field: null } }));
        return;
      }
      lane.next = { id, text, answered };
      send(lane);
    },
  };
}
