// Clicks on our own HTML in viser's panels: <img data-ltvn-action="select" data-id="17">.

function onClick(event) {
  const clicked = event.target instanceof Element ? event.target.closest("[data-ltvn-action]") : null;
  if (clicked === null) return;
  const id = clicked.dataset.id === undefined ? null : Number(clicked.dataset.id);
  if (id === null || Number.isSafeInteger(id)) ask(clicked.dataset.ltvnAction, id);
}

function listenToClicks() {
  document.addEventListener("click", onClick, true);
}
