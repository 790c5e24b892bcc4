// Clicks on our own HTML in viser's panels: <img data-ltvn-action="select" data-id="17">, and data-text where an
// action is about a name. Enter clicks as well.

let focusedControl = null; // Selector of our control that has the focus, which viser may draw anew.

function onClick(event) {
  const clicked = event.target instanceof Element ? event.target.closest("[data-ltvn-action]") : null;
  if (clicked === null) return;
  const { ltvnAction, id, text } = clicked.dataset;
  const value = text ?? (id === undefined ? null : Number(id));
  if (typeof value !== "number" || Number.isSafeInteger(value)) ask(ltvnAction, value);
}

function onEnter(event) {
  const control = event.target;
  if (event.key !== "Enter" || !(control instanceof Element) || !control.matches("[data-ltvn-action]:not(button)")) return;
  event.preventDefault();
  control.click();
}

function rememberFocus({ target }) {
  const { ltvnAction, id } = target.dataset ?? {};
  focusedControl = ltvnAction === undefined ? null : `[data-ltvn-action="${ltvnAction}"]${id === undefined ? "" : `[data-id="${id}"]`}`;
}

// To be called when the panels were drawn anew: a control that stood there before keeps the focus.
function restoreFocus() {
  if (focusedControl === null || document.activeElement !== document.body) return;
  document.querySelector(`#root ${focusedControl}`)?.focus({ preventScroll: true });
}

function listenToClicks() {
  document.addEventListener("click", onClick, true);
  document.addEventListener("keydown", onEnter, true);
  document.addEventListener("focusin", rememberFocus);
  document.addEventListener("pointerdown", () => (focusedControl = null), true);
}
