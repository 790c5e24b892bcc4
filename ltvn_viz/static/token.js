// The token, by which the server knows that the person before this page may see the session and drive. It comes in the
// fragment of the link, which no browser sends anywhere, and stays in the store of this tab, which only pages of this
// very address can read. A new tab begins without it: it is opened by the printed link, or asks for that.

// The page may stand below a path, behind a proxy. An address of the server, such as "/drive", begins where the page does.
function addressOf(path) {
  return new URL(path.slice(1), new URL(".", location.href)).href;
}

const TOKEN_STORE = "ltvn-token";

let token = takeToken() ?? storedToken();

function tokenIn(address) {
  return new URLSearchParams(address.split("#")[1] ?? "").get("token");
}

function storedToken() {
  try {
    return sessionStorage.getItem(TOKEN_STORE);
  } catch {
    return null;
  }
}

// Where the browser keeps nothing, the token stays in the address, so that the page can be loaded again.
function takeToken() {
  const given = tokenIn(location.href);
  if (given === null) return null;
  try {
    sessionStorage.setItem(TOKEN_STORE, given);
    history.replaceState(null, "", location.pathname + location.search);
  } catch {
    // Said above.
  }
  return given;
}

// A link that differs from this page's address by the token alone does not load the page again by itself.
addEventListener("hashchange", () => {
  if (takeToken() !== null) location.reload();
});

function proof() {
  return { type: "proof", token: token ?? "" };
}

function fetchWithToken(address) {
  return fetch(addressOf(address), { headers: { Authorization: `Bearer ${token ?? ""}` } });
}

const NO_TOKEN = "This page needs the token of the app that is running. Paste the address that its terminal printed:";
const OLD_TOKEN =
  "The app was started again, so the token of this page is worthless. Open the new link in the app's terminal, or paste the address here:";

function askForToken() {
  if (document.body === null) return addEventListener("DOMContentLoaded", askForToken, { once: true });
  if (document.getElementById("ltvn-ask") !== null) return;
  const form = document.createElement("form");
  form.id = "ltvn-ask";
  const label = document.createElement("label");
  label.textContent = token === null ? NO_TOKEN : OLD_TOKEN;
  const field = document.createElement("input");
  field.autocomplete = "off";
  field.placeholder = `${addressOf("/")}#token=…`;
  label.append(field);
  form.append(label);
  form.addEventListener("submit", (event) => event.preventDefault());
  field.addEventListener("input", () => {
    const given = tokenIn(field.value.trim());
    // A reload, which keeps what else the address of this page asks for.
    if (given !== null) location.hash = new URLSearchParams({ token: given });
  });
  document.body.append(form);
  field.focus();
}
