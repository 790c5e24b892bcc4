// What is printed on the keys. Keys go by their place, so that a key is named as this keyboard has it where the browser
// tells (Chromium does), and as a US keyboard has it elsewhere. Panels come from the server with US caps; they are put
// right here.

const caps = { ...KEYMAP.caps };
const CODE_OF_CAP = Object.fromEntries(Object.entries(KEYMAP.caps).map(([code, cap]) => [cap, code]));
const PALETTE = ".mantine-Spotlight-actionDescription";
const KEYS_IN_PANELS = `#root kbd, .ltvn-by-key, ${PALETTE}`;
const LETTER_ALONE = /\b[A-Z]\b/g;

function capOf(code) {
  return caps[code] ?? code;
}

// One key by its US cap: "]" is "+" on a German keyboard.
function ownCap(cap) {
  return capOf(CODE_OF_CAP[cap] ?? cap);
}

// A text that names letters by their US caps, as "W A S D".
function ownLetters(text) {
  return text.replace(LETTER_ALONE, ownCap);
}

// The keys of an action, as "A or ;", and in the palette "Key: A or ;".
function ownKeys(text) {
  return text.split(/(^Key: | or )/).map(ownCap).join("");
}

function nameKeysInPanels() {
  for (const place of document.querySelectorAll(KEYS_IN_PANELS)) {
    const known = place.dataset;
    if (place.textContent !== known.ltvnOwn) known.ltvnUs = place.textContent; // viser wrote it anew.
    known.ltvnOwn = (place.matches(".ltvn-by-key") ? ownLetters : ownKeys)(known.ltvnUs);
    if (place.textContent !== known.ltvnOwn) place.textContent = known.ltvnOwn;
  }
}

// The palette stands outside of the panels, and its entries change while somebody types.
function nameKeysInPalette() {
  const name = () => document.querySelector(PALETTE) !== null && nameKeysInPanels();
  new MutationObserver(name).observe(document.body, { childList: true, subtree: true, characterData: true });
}

// Calls `learned` once if this keyboard is known, whose caps may be others.
async function learnCaps(learned) {
  try {
    const layout = await navigator.keyboard.getLayoutMap();
    for (const code of Object.keys(caps)) {
      const printed = layout.get(code);
      // A dotless or sharp letter has no capital of one letter.
      if (printed !== undefined) caps[code] = printed.toUpperCase().length === 1 ? printed.toUpperCase() : printed;
    }
    learned();
  } catch {
    // No such thing in this browser, or in a frame: US caps.
  }
}
