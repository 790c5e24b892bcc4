// What a page without the seat may not do is grey and says why. The server decides; this only shows it.

function whyNot() {
  return `${nameOfDriver(seat.driver)} drives. Take over to use this.`;
}

function isFree(control) {
  return KEYMAP.everybody.includes(control.dataset.ltvnAction);
}

function explain(event) {
  const control = controlOf(event.target);
  if (control === null || isFree(control) || (!isWatching() && !("ltvnHint" in control.dataset))) return;
  control.dataset.ltvnHint ??= control.title;
  control.title = isWatching() ? whyNot() : control.dataset.ltvnHint;
}

function showWatching() {
  document.documentElement.toggleAttribute("data-ltvn-watching", isWatching());
}

function showRights() {
  watchers.push(showWatching);
  addEventListener("pointerover", explain, true);
}
