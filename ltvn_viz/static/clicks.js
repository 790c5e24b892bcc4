// Clicks on our own HTML in viser's panels: <img data-ltvn-action="select" data-id="17">, and data-text where an
// action is about a name. Enter clicks as well. They stay alive while viser's socket is lost.

const DRAG_PX = 4; // A pointer that moved farther between press and release turned the view.

let pressedControl = null; // Our control where the pointer went down.
let pressedAt = { x: 0, y: 0 }; // Where the pointer went down, in pixels.
let focusedControl = null; // Selector of our control that has the focus, which viser may draw anew.

const PRESSED = "[data-ltvn-action], [data-ltvn-toggle]";

function controlOf(target, kind = "[data-ltvn-action]") {
  return target instanceof Element ? target.closest(kind) : null;
}

function onClick(event) {
  const clicked = controlOf(event.target);
  if (clicked === null) return sayIfDead(event);
  const { ltvnAction, id, text } = clicked.dataset;
  const value = text ?? (id === undefined ? null : Number(id));
  if (typeof value !== "number" || Number.isSafeInteger(value)) ask(ltvnAction, value);
}

// A panel may be drawn anew between press and release; the browser then reports no click.
function onPress({ target, button, clientX, clientY }) {
  pressedAt = { x: clientX, y: clientY };
  pressedControl = button === 0 ? controlOf(target, PRESSED) : null;
}

function onRelease({ clientX, clientY }) {
  if (pressedControl === null || pressedControl.isConnected) return;
  const control = controlOf(document.elementFromPoint(clientX, clientY), PRESSED);
  if (control !== null && isSameControl(control, pressedControl)) control.click();
}

function isSameControl(one, other) {
  return ["ltvnAction", "ltvnToggle", "id", "text"].every((name) => one.dataset[name] === other.dataset[name]);
}

// viser greys its own controls while its socket is lost, and hides them from the pointer.
function sayIfDead(event) {
  if (!isViserOpen && event.isTrusted && viserPanel()?.contains(event.target)) sayUnheard("The press");
}

function isDrag({ clientX, clientY }) {
  return Math.hypot(clientX - pressedAt.x, clientY - pressedAt.y) > DRAG_PX;
}

function onEnter(event) {
  const control = event.target;
  if (event.key !== "Enter" || !(control instanceof Element) || !control.matches("[data-ltvn-action]:not(button)")) return;
  event.preventDefault();
  control.click();
}

function rememberFocus({ target }) {
  const { ltvnAction, id, text } = target.dataset ?? {};
  const about = text === undefined ? (id === undefined ? "" : `[data-id="${id}"]`) : `[data-text="${CSS.escape(text)}"]`;
  focusedControl = ltvnAction === undefined ? null : `[data-ltvn-action="${ltvnAction}"]${about}`;
}

// To be called when the panels were drawn anew: a control that stood there before keeps the focus.
function restoreFocus() {
  if (focusedControl === null || document.activeElement !== document.body) return;
  document.querySelector(`#root ${focusedControl}`)?.focus({ preventScroll: true });
}

function listenToClicks() {
  document.addEventListener("click", onClick, true);
  document.addEventListener("pointerdown", onPress, true);
  document.addEventListener("pointerup", onRelease, true);
  document.addEventListener("keydown", onEnter, true);
  document.addEventListener("focusin", rememberFocus);
  document.addEventListener("pointerdown", () => (focusedControl = null), true);
}
