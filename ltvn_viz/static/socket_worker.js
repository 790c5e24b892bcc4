// The page's connection to the robot, in a thread of its own. So the server hears that the page is there however long
// the page draws, and while it is behind another one, where a page's own timers run once a second. A page that was
// frozen, or does not answer its worker any more, is not there.
//
// What is held is repeated here, so that no key is lost while the page draws. Each time it says how long ago the page
// itself last knew it; the server lets an old hand drive slowly, and soon not at all.
//
// A press on a button while the connection is lost is kept and sent once when the connection is back. After KEPT_MS the
// page says instead that the press was not heard: an old press must not start a robot. Held keys are never kept.

const HERE_MS = 50;
const RECONNECT_MS = 500; // At first; longer each time, so that many pages do not storm an app that was away for long.
const RECONNECT_MOST_MS = 3000;
const KEPT_MS = 2000;
const ASK_MS = 1000;
const HUNG_MS = 10000;
const SILENT_MS = 1000; // The server says something every quarter of a second; without that, what the page shows is old.
const BEAT = '{"type": "beat"}'; // As in `drive_messages.py`.
const TOKEN_REFUSED = 4401; // As in `requests.py`.

let socket = null;
let isFrozen = false;
let heardAt = null; // When the server last said something; null before it first did.
let isAccepted = false; // Whether the server has said something on this connection.
const kept = new Map(); // Action -> its message and until when it may be sent; a later press replaces an earlier one.
let inVain = 0; // How many connections were closed since the server last said something.
let isSilent = false;
let answered = performance.now();
let held = null; // What the page holds, as it last said, and when it did.
let heldAt = 0;
let heldText = "";

function connect(address, proof) {
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => send(proof);
  socket.onmessage = ({ data }) => {
    heardAt = performance.now();
    inVain = 0;
    if (!isAccepted) sendKept();
    if (data === BEAT) return;
    if (data instanceof ArrayBuffer) postMessage({ type: "picture", jpeg: data }, [data]);
    else postMessage({ type: "heard", text: data });
  };
  socket.onclose = ({ code }) => {
    held = null;
    isAccepted = false;
    inVain += 1;
    postMessage({ type: "lost", inVain: heardAt === null ? inVain : 0 });
    if (code === TOKEN_REFUSED) postMessage({ type: "refused" });
    else setTimeout(connect, Math.min(RECONNECT_MS * 1.3 ** (inVain - 1), RECONNECT_MOST_MS), address, proof);
  };
}

function send(text) {
  if (socket !== null && socket.readyState === WebSocket.OPEN) socket.send(text);
}

function sendKept() {
  isAccepted = true;
  for (const [action, { message, until }] of kept) {
    // The computer may have slept meanwhile, and timers with it.
    if (Date.now() <= until) send(JSON.stringify(message));
    else postMessage({ type: "unheard", action });
  }
  kept.clear();
}

// Before the first connection nothing has been seen of the robot that could have changed, so everything is kept.
function ask(message, isKey) {
  const { action } = message;
  if (isAccepted && socket.readyState === WebSocket.OPEN) return send(JSON.stringify(message));
  if (heardAt !== null && isKey && action !== "stop") return postMessage({ type: "unheard", action });
  const press = { message, until: heardAt === null ? Infinity : Date.now() + KEPT_MS };
  kept.set(action, press);
  if (heardAt !== null) setTimeout(forget, KEPT_MS, action, press);
}

function forget(action, press) {
  if (kept.get(action) !== press) return;
  kept.delete(action);
  postMessage({ type: "unheard", action });
}

function hold(message) {
  heldAt = performance.now();
  const text = JSON.stringify(message);
  if (held !== null && text === heldText) return; // It goes out with the next beat.
  heldText = text;
  held = message.held.length > 0 || message.stick.some((part) => part !== 0) ? message : null;
  sendHeld(message);
}

function sendHeld(message) {
  send(JSON.stringify({ ...message, age: Math.round(performance.now() - heldAt) }));
}

// The worker's own timers may stand still, with the whole computer: then nothing is known, and nothing is said.
function listenForSilence() {
  if (heardAt === null) return;
  const silent = performance.now() - heardAt > SILENT_MS;
  if (silent !== isSilent) postMessage({ type: "silence", isSilent: silent });
  isSilent = silent;
}

function beat() {
  sayHere();
  listenForSilence();
  if (held !== null && !isFrozen) sendHeld(held);
}

function sayHere() {
  if (!isFrozen && performance.now() - answered < HUNG_MS) send('{"type":"here"}');
}

onmessage = ({ data }) => {
  answered = performance.now();
  if (data.type === "connect") connect(data.address, data.proof);
  else if (data.type === "hold") hold(data.message);
  else if (data.type === "ask") ask(data.message, data.isKey);
  else if (data.type === "send") send(data.text);
  else if (data.type === "freeze") isFrozen = data.frozen;
};
setInterval(beat, HERE_MS);
setInterval(postMessage, ASK_MS, { type: "ask" });
