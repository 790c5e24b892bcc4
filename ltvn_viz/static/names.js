// Names for what viser draws without any, so that a screen reader can say what it is.

const NAMELESS = [
  [".mantine-CloseButton-root", { "aria-label": "close" }],
  ["div[aria-haspopup=dialog]", { "role": "button", "tabindex": "0", "aria-label": "properties" }],
  ["#root img:not([alt])", { "alt": "" }],
  [".mantine-Spotlight-content", { "aria-label": "commands" }],
  [".mantine-Spotlight-search", { "aria-label": "search commands, or type the number of a node" }],
  [".mantine-Spotlight-content .mantine-ScrollArea-viewport", { "tabindex": "0" }],
];

function nameControls() {
  for (const [selector, names] of NAMELESS) {
    for (const control of document.querySelectorAll(selector)) {
      for (const [name, value] of Object.entries(names)) {
        if (!control.hasAttribute(name)) control.setAttribute(name, value);
      }
    }
  }
}
