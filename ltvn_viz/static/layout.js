// The page's frame: what of viser's panel stands elsewhere, the sheet of a narrow window, and the loading screen.
// Where everything stands is `layout.css`.

const NARROW = "(max-width: 699.98px), (max-width: 1099.98px) and (max-height: 479.98px)";
const VISER_NARROW = "(max-width: 36em)";
const SHOW_ANYWAY_MS = 10000;
const PANEL = "[data-ltvn-panel]";
const COPIED = "[data-ltvn-copy]";

// viser asks the window once whether it is narrow. Its panel for narrow windows is one plain element, with tabs that
// screen readers know, at whatever width; the one for wide windows floats.
function keepViserNarrow() {
  const ask = window.matchMedia;
  window.matchMedia = function (query) {
    return ask.call(this, query === VISER_NARROW ? "all" : query);
  };
}

function byId(id) {
  return document.getElementById(id);
}

// A piece of a panel that belongs elsewhere on the page is copied there whenever it changes, if that place is shown.
function copyPieces() {
  for (const piece of document.querySelectorAll(`#root ${COPIED}`)) {
    const place = byId(`ltvn-${piece.dataset.ltvnCopy}`);
    const content = place.checkVisibility() ? piece.innerHTML : "";
    if (place.innerHTML !== content) place.innerHTML = content;
  }
}

function viserPanel() {
  return document.querySelector(`#root .mantine-Paper-root:has(${PANEL})`);
}

// What has no name of its own in viser's panel gets one of ours: the column that it fixes, and its handle.
function nameViserParts() {
  const handle = viserPanel()?.querySelector("div:has(> .tabler-icon-cloud-check), div:has(> .mantine-ActionIcon-root)");
  if (handle === null || handle === undefined) return;
  handle.dataset.ltvnViser = "handle";
  handle.parentElement.dataset.ltvnViser = "inner";
}

// viser says that a file was uploaded as soon as its bytes have come. Whether they are an image, the app says itself.
const UPLOADED = "File uploaded successfully";

function hideUploadedNotes() {
  for (const text of document.querySelectorAll("#root .mantine-Notification-description")) {
    const note = text.closest(".mantine-Notification-root");
    note.toggleAttribute("data-ltvn-hidden", text.textContent.startsWith(UPLOADED));
  }
}

function tabs() {
  return [...(viserPanel()?.querySelectorAll("[role=tab]") ?? [])];
}

// viser builds its panel anew when its socket was cut, with the first tab open: the page opens the one chosen last. The
// choice is noted as it is made, because the panel may be built anew before the page has seen the tab open. What a
// person chose outlasts a reload, too.
let chosenTab = history.state?.tab ?? null;

function noteChosenTab(event) {
  const tab = event.target.closest?.("#root [role=tab]");
  if (!tab) return;
  chosenTab = tab.textContent.trim();
  if (event.isTrusted) history.replaceState({ tab: chosenTab }, "");
}

// Until a person chooses one, the tab that the app's first hint names.
function firstTab() {
  return (seat.isOpen && document.querySelector("#root [data-ltvn-tab]")?.dataset.ltvnTab) || null;
}

function keepTab() {
  chosenTab ??= firstTab();
  const chosen = tabs().find((tab) => tab.textContent.trim() === chosenTab);
  if (chosen?.getAttribute("aria-selected") === "false") chosen.click();
}

function openSheet(tab) {
  tab?.click();
  document.documentElement.dataset.ltvnSheet = "";
  showSheet();
}

function closeSheet() {
  delete document.documentElement.dataset.ltvnSheet;
  showSheet();
}

function isSheetOpen() {
  return "ltvnSheet" in document.documentElement.dataset;
}

// On a phone an open tab covers the map, so it closes as soon as the next step is a click there.
let awaitedClick = null;

function makeRoomForClick() {
  const awaited = document.querySelector("#root [data-ltvn-scene]")?.textContent ?? null;
  if (awaited !== null && awaited !== awaitedClick) closeSheet();
  awaitedClick = awaited;
}

function onNav(tab) {
  if (isSheetOpen() && tab.getAttribute("aria-selected") === "true") closeSheet();
  else openSheet(tab);
}

function showSheet() {
  const known = byId("ltvn-nav").children;
  const wanted = tabs();
  if (known.length !== wanted.length) {
    byId("ltvn-nav").replaceChildren(...wanted.map((tab, index) => navButton(tab.textContent, index)));
  }
  wanted.forEach((tab, index) => {
    const isShown = isSheetOpen() && tab.getAttribute("aria-selected") === "true";
    known[index].setAttribute("aria-expanded", String(isShown));
  });
  const top = matchMedia(NARROW).matches && innerHeight >= 480 ? byId("ltvn-pictures") : byId("ltvn-bar");
  const style = document.documentElement.style;
  style.setProperty("--ltvn-sheet-top", `${top.getBoundingClientRect().bottom}px`);
  // What is said of moments leaves the timeline in view.
  const isOfTime = wanted.some((tab) => tab.getAttribute("aria-selected") === "true" && /Replay|Why/.test(tab.textContent));
  const foot = isOfTime ? byId("timeline-dock") : byId("ltvn-nav");
  style.setProperty("--ltvn-sheet-bottom", `${innerHeight - foot.getBoundingClientRect().top}px`);
}

function navButton(text, index) {
  const made = element("button", "", text);
  made.type = "button";
  made.addEventListener("click", () => onNav(tabs()[index]));
  return made;
}

function toggleViserSettings() {
  // The last of viser's buttons there; the command palette has one as well.
  [...document.querySelectorAll("[data-ltvn-viser=handle] button")].at(-1)?.click();
  document.documentElement.toggleAttribute("data-ltvn-advanced");
}

function showPage() {
  document.documentElement.dataset.ltvnReady = "";
}

// viser's panel first shows viser's settings, and then folds them up: until that is done, everything below them moves.
function isPanelAtRest() {
  const parts = document.querySelector("[data-ltvn-viser=inner] > :last-child")?.children ?? [];
  return viserPanel() !== null && [...parts].filter((part) => part.offsetHeight > 0).length <= 1;
}

function endLoading() {
  if (isPanelAtRest()) showPage();
  // Whatever keeps the panel away, nobody shall look at a loading screen for ever.
  else if (seat.isOpen) endLoading.due ??= setTimeout(showPage, SHOW_ANYWAY_MS);
}

function arrange() {
  nameViserParts();
  nameControls();
  hideUploadedNotes();
  keepTab();
  makeRoomForClick();
  nameKeysInPanels();
  copyPieces();
  restoreFocus();
  showSheet();
  endLoading();
}

function arrangeSoon() {
  arrangeSoon.due ??= setTimeout(() => {
    arrangeSoon.due = null;
    arrange();
  }, 30);
}

function layOut() {
  byId("root").setAttribute("role", "main");
  byId("ltvn-close").addEventListener("click", closeSheet);
  const all = { childList: true, subtree: true, characterData: true, attributes: true, attributeFilter: ["aria-selected"] };
  new MutationObserver(arrangeSoon).observe(byId("root"), all);
  byId("root").addEventListener("transitionend", arrangeSoon);
  addEventListener("resize", arrangeSoon);
  addEventListener("click", noteChosenTab, true);
  new ResizeObserver(arrangeSoon).observe(byId("ltvn-pictures"));
  watchers.push(endLoading, keepTab);
  arrange();
}
