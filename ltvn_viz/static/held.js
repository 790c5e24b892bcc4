// Everything that is held at this moment, on keys, pad and gamepad together.
//
// The whole set is told to the socket's worker on each change and, while anything is held, 20 times a second. The worker
// repeats it to the server, which stops the robot when the heartbeat stays away or says that this page knows nothing new.
// Nothing here remembers what was held before the page lost sight of its input.

const HEARTBEAT_MS = 50;

const held = new Map(); // What is pressed ("KeyW", "pad forward") -> direction.
let stick = [0, 0]; // Forward and left, each in [-1, 1].
let isSlow = false;
let isStickStale = false; // The stick must pass its centre before it counts again.
let heartbeat = null;

function isHolding() {
  return held.size > 0 || stick[0] !== 0 || stick[1] !== 0;
}

function hold(source, direction) {
  if (held.has(source)) return;
  held.set(source, direction);
  heldChanged();
}

function drop(source) {
  if (held.delete(source)) heldChanged();
}

function moveStick(forward, left) {
  if (forward === 0 && left === 0) isStickStale = false;
  else if (isStickStale) return;
  if (forward === stick[0] && left === stick[1]) return;
  stick = [forward, left];
  heldChanged();
}

function setSlow(value) {
  if (value === isSlow) return;
  isSlow = value;
  if (isHolding()) heldChanged();
}

function dropAll() {
  if (stick[0] !== 0 || stick[1] !== 0) isStickStale = true;
  held.clear();
  stick = [0, 0];
  heldChanged();
}

function heldChanged() {
  report();
  if (isHolding() && heartbeat === null) heartbeat = setInterval(report, HEARTBEAT_MS);
  if (!isHolding() && heartbeat !== null) {
    clearInterval(heartbeat);
    heartbeat = null;
  }
  changed();
}

function report() {
  tellHeld({ type: "drive", held: [...new Set(held.values())], stick, slow: isSlow, epoch: seat.epoch });
}

function dropAllWhenOutOfSight() {
  for (const name of ["pagehide", "freeze"]) addEventListener(name, dropAll, true);
  // A button that is drawn anew while it has the focus loses it; that takes no key out of anybody's hand.
  addEventListener("blur", (event) => event.target === window && dropAll(), true);
  document.addEventListener("freeze", dropAll);
  document.addEventListener("visibilitychange", () => document.hidden && dropAll());
  addEventListener("focusin", (event) => isTyping(event.target) && dropAll());
}
