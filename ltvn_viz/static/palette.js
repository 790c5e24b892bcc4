// “Go to node …” in viser's palette, whose entries cannot carry a number: what is typed is read here.

const PALETTE_FIELD = ".mantine-Spotlight-search";
const GO_TO_NODE = "Go to node …"; // As `panels/command_palette.py` lists it.
let hasMovedInPalette = false; // Whether an entry was chosen by the arrow keys since something was typed.

// The number in “30”, “node 30” or “go to node 30”; null where something else is typed.
function typedNode(text) {
  const found = /^(?:go\s*to\s*)?(?:node\s*)?#?(\d{1,15})$/i.exec(text.trim());
  return found === null ? null : Number(found[1]);
}

function showTypedNode(field) {
  const node = typedNode(field.value);
  const before = byId("ltvn-go-to-node");
  if (node === null) return before?.remove();
  const row = before ?? button("ltvn-go-to-node", "", "");
  row.id = "ltvn-go-to-node";
  row.textContent = `Go to node ${node}`;
  row.setAttribute("aria-label", row.textContent);
  row.onclick = () => goToTypedNode(field, node);
  if (before === null) field.closest("[role=dialog]").append(row);
}

function goToTypedNode(field, node) {
  ask("goal", node);
  field.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape", code: "Escape", bubbles: true }));
}

// The one entry without a number: the field asks for it.
function askForNode(event, field) {
  swallow(event);
  Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(field, "node ");
  field.dispatchEvent(new Event("input", { bubbles: true }));
  field.focus();
}

function isGoToNode(entry) {
  return entry?.querySelector(".mantine-Spotlight-actionLabel")?.textContent === GO_TO_NODE && !entry.disabled;
}

function onKeyInPalette(event) {
  const field = event.target;
  if (event.key.startsWith("Arrow")) hasMovedInPalette = true;
  if (event.key !== "Enter") return;
  const node = typedNode(field.value);
  if (node !== null && !hasMovedInPalette) {
    swallow(event);
    goToTypedNode(field, node);
  } else if (isGoToNode(document.querySelector(".mantine-Spotlight-action[data-selected]"))) askForNode(event, field);
}

function listenToPalette() {
  addEventListener("keydown", (event) => event.target.matches?.(PALETTE_FIELD) && onKeyInPalette(event), true);
  addEventListener("input", (event) => {
    if (!event.target.matches?.(PALETTE_FIELD)) return;
    hasMovedInPalette = false;
    showTypedNode(event.target);
  });
  addEventListener(
    "click",
    (event) => {
      const field = document.querySelector(PALETTE_FIELD);
      if (field !== null && isGoToNode(event.target.closest?.(".mantine-Spotlight-action"))) askForNode(event, field);
    },
    true,
  );
  // Its dialog comes and goes beside the panels.
  new MutationObserver(() => document.querySelector(PALETTE_FIELD) !== null && nameControls()).observe(document.body, {
    childList: true,
    subtree: true,
  });
}
