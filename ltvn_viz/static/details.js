// What is there for whoever asks: the numbers behind the word of health, and the glossary. Both stay open while the
// panels are drawn anew, because it is the page that remembers.

function showGlossary() {
  if (document.querySelector(".ltvn-glossary") !== null) return;
  const dialog = element("dialog", "ltvn-glossary");
  dialog.setAttribute("role", "dialog");
  dialog.setAttribute("aria-label", "what the words mean");
  const list = element("dl", "");
  for (const { symbol, name, text } of GLOSSARY) {
    list.append(element("dt", "", symbol === "" || symbol === name ? name : `${symbol}: ${name}`), element("dd", "", text));
  }
  const close = element("button", "ltvn-time-button", "Close");
  close.type = "button";
  close.addEventListener("click", () => dialog.close());
  dialog.addEventListener("close", () => dialog.remove());
  const head = element("h2", "", "What the words mean");
  head.append(close);
  dialog.append(head, list);
  document.body.append(dialog);
  dialog.showModal();
}

function onToggle(event) {
  const asked = event.target instanceof Element ? event.target.closest("[data-ltvn-toggle]") : null;
  if (asked === null) return;
  if (asked.dataset.ltvnToggle === "glossary") showGlossary();
  else if (asked.dataset.ltvnToggle === "advanced") toggleViserSettings();
  else document.documentElement.toggleAttribute("data-ltvn-numbers");
}

function listenToToggles() {
  document.addEventListener("click", onToggle, true);
}
