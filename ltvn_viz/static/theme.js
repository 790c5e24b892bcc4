// Dark or light, as the system asks, on each page by itself. viser's server would say it to all pages at once, and viser
// writes it onto the document; that is put right before anything is drawn. The colours themselves are `theme.css`.

const SCHEME = "data-mantine-color-scheme";
const light = matchMedia("(prefers-color-scheme: light)");

function followScheme() {
  const root = document.documentElement;
  const wanted = light.matches ? "light" : "dark";
  if (root.getAttribute(SCHEME) !== wanted) root.setAttribute(SCHEME, wanted);
}

function keepScheme() {
  new MutationObserver(followScheme).observe(document.documentElement, { attributeFilter: [SCHEME] });
  light.addEventListener("change", followScheme);
  followScheme();
}
