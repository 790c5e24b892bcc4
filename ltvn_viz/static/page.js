// The page's name at the server: a secret that no other page is told. The page's two sockets, viser's and ours, both
// carry it, so that whatever is clicked in viser's panels is judged by the seat of the page where it was clicked.

const PAGE_KEY = Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");

function socketAddress(path) {
  return `${location.origin.replace(/^http/, "ws")}${path}?page=${PAGE_KEY}`;
}

const ASK_WHETHER_THERE_MS = 200;
const ASK_IN_VAIN = 25;

// The page is served before the app is loaded, so that the browser unpacks viser meanwhile.
const appIsThere = new Promise((resolve) => askWhetherThere(resolve, ASK_IN_VAIN));

async function askWhetherThere(resolve, tries) {
  let isThere = false;
  try {
    isThere = await (await fetch("/ready/0.json")).json();
    tries = ASK_IN_VAIN;
  } catch {
    tries -= 1;
    if (tries === 0) byId("ltvn-loading-text").textContent = "The app has ended. Its terminal says why.";
  }
  if (isThere) resolve();
  else setTimeout(askWhetherThere, ASK_WHETHER_THERE_MS, resolve, tries);
}

// viser's socket lives in a worker, which is told where to connect by this one message.
function nameViserSocket() {
  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (message, ...rest) {
    if (message?.type !== "set_server") return post.call(this, message, ...rest);
    appIsThere.then(() => post.call(this, { ...message, server: socketAddress("/") }, ...rest));
  };
}
