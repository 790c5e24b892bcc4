// Keys: held ones drive, pressed ones ask. viser listens on `document`; this listens on `window` in the capture phase,
// so that a driving key never reaches viser's camera.
//
// The keyboard is the scene's until Tab carries the focus into a panel. There the arrows choose tabs and entries, and
// nothing drives; Escape or a click gives the keyboard back. Space stops the robot wherever the focus is.

const NOT_TYPED_INTO = new Set(["button", "checkbox", "color", "file", "image", "radio", "range", "reset", "submit"]);
const REPEATING = new Set(["seek_back", "seek_forward", "event_before", "event_after", "query_before", "query_after"]);

let isFocusByTab = false; // A control that was clicked has the focus too, but nobody means to type there.
let lastKey = ""; // Shown on the pad until it is let go, so that a person sees whether keys arrive at all.

function isTyping(target) {
  if (!(target instanceof HTMLElement)) return false;
  if (target.isContentEditable || target.tagName === "TEXTAREA" || target.tagName === "SELECT") return true;
  // A list keeps the keyboard after a choice was made; only while it is open are keys meant for it.
  if (target.getAttribute("aria-haspopup") === "listbox") return target.hasAttribute("aria-controls");
  return target.tagName === "INPUT" && !NOT_TYPED_INTO.has(target.type);
}

function isInPanels() {
  const focused = document.activeElement;
  return isFocusByTab && focused instanceof HTMLElement && focused !== document.body && !focused.matches("#root canvas");
}

function giveKeysBack() {
  if (!isFocusByTab) return;
  isFocusByTab = false;
  changed();
}

function leavePanels(event) {
  swallow(event);
  giveKeysBack();
  document.activeElement.blur();
}

function isAdjusting(target, code) {
  return code.startsWith("Arrow") && target instanceof HTMLElement && target.getAttribute("role") === "slider";
}

function swallow(event) {
  event.preventDefault();
  event.stopImmediatePropagation();
}

function onKeyDown(event) {
  if (isTyping(event.target)) return;
  if (onPlanKey(event)) return;
  const action = KEYMAP.actions[event.code];
  if (action === "stop") return pressStop(event);
  if (event.code === "Tab") isFocusByTab = true;
  if (isInPanels() && event.code === "Escape" && !isDialogOpen()) return leavePanels(event);
  // These take the keyboard away to the browser or the desktop; the release of what is held may never arrive.
  if (event.ctrlKey || event.metaKey || event.altKey) return dropAll();
  setSlow(event.shiftKey);
  const direction = KEYMAP.directions[event.code];
  if (direction !== undefined && !isInPanels() && !isAdjusting(event.target, event.code)) pressDirection(event, direction);
  else if (direction === undefined && action !== undefined) pressAction(event, action);
}

function pressStop(event) {
  swallow(event);
  if (event.repeat) return;
  lastKey = event.code;
  ask("stop");
  changed();
}

function pressDirection(event, direction) {
  swallow(event);
  // A key that was held while the page lost sight of it repeats, and must not count until it is pressed anew.
  if (event.repeat) return;
  lastKey = event.code;
  hold(event.code, direction);
}

function isDialogOpen() {
  return document.querySelector("[role=dialog]") !== null;
}

function pressAction(event, action) {
  if (event.repeat && !REPEATING.has(action)) return;
  if (isDialogOpen()) return;
  event.preventDefault();
  lastKey = event.code;
  if (action === "help") toggleHelp();
  else ask(action, null, true);
  changed();
}

function onKeyUp(event) {
  setSlow(event.shiftKey);
  if (event.code === lastKey) {
    lastKey = "";
    changed();
  }
  // Space let go on a button would click it.
  if (KEYMAP.actions[event.code] === "stop" && !isTyping(event.target)) swallow(event);
  if (!held.has(event.code)) return;
  event.stopImmediatePropagation();
  drop(event.code);
}

function listenToKeys() {
  addEventListener("keydown", onKeyDown, true);
  addEventListener("keyup", onKeyUp, true);
  addEventListener("pointerdown", giveKeysBack, true);
}
