// The page's name at the server: a secret that no other page is told. The page's two sockets, viser's and ours, both
// carry it, so that whatever is clicked in viser's panels is judged by the seat of the page where it was clicked.

const PAGE_KEY = Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");

function socketAddress(path) {
  return `${addressOf(path).replace(/^http/, "ws")}?page=${PAGE_KEY}`;
}

const ASK_WHETHER_THERE_MS = 200;
const ASK_IN_VAIN = 25;
const FETCHES = "The app is running. This page is loading the scene; without a graphics card that takes about ten seconds…";
const UNAUTHORIZED = 401;
const FORBIDDEN = 403;
const SOCKETS_IN_VAIN = 4;
const BEHIND_PROXY =
  "If a proxy is in between, go without it: ssh -L PORT:127.0.0.1:PORT THAT_MACHINE, with the port of the link in the app's terminal; then open that link.";
const TOKEN_REFUSED = "token refused"; // As in `requests.py`.
const VISER_MESSAGES = ["zstd_wasm", "set_server"]; // The first that viser's page says to the worker of its socket.

let isViserOpen = false; // Whether viser's socket is connected; without it, viser's own controls take no press.

// The page is served before the app is loaded, so that the browser unpacks viser meanwhile.
const appIsThere = new Promise((resolve) => askWhetherThere(resolve, ASK_IN_VAIN));

async function askWhetherThere(resolve, tries) {
  let step = null;
  try {
    const answer = await fetchWithToken("/ready/0.json");
    if (answer.status === UNAUTHORIZED) return askForToken();
    if (answer.ok) step = await answer.json();
    else sayWhileLoading(`${answer.status === FORBIDDEN ? await answer.text() : `The answer is ${answer.status} ${answer.statusText}.`} ${BEHIND_PROXY}`);
    tries = ASK_IN_VAIN;
  } catch {
    tries -= 1;
    if (tries === 0) sayWhileLoading("The app has ended. Its terminal says why.");
  }
  if (step !== null) sayWhileLoading(step || FETCHES);
  if (step === "") resolve();
  else setTimeout(askWhetherThere, ASK_WHETHER_THERE_MS, resolve, tries);
}

// The page came, but none of its sockets was accepted.
function sayInVain() {
  sayWhileLoading(`The app is running, but it refuses the connection of this page, or a proxy lets none through. ${BEHIND_PROXY}`);
}

function sayWhileLoading(text) {
  const place = document.getElementById("ltvn-loading-text");
  if (place !== null) place.textContent = text;
}

// viser's socket lives in a worker, which is told where to connect by one message. Once it says that it is connected,
// the token goes first. viser sends as soon as its own listener hears that; ours is there before it, because a worker
// gets its first message before it gets that listener.
function letViserIn() {
  const post = Worker.prototype.postMessage;
  const known = new WeakSet();
  Worker.prototype.postMessage = function (message, ...rest) {
    if (VISER_MESSAGES.includes(message?.type) && !known.has(this)) {
      known.add(this);
      this.addEventListener("message", ({ data }) => {
        if (["connected", "closed"].includes(data?.type)) isViserOpen = data.type === "connected";
        if (data?.type === "connected") post.call(this, { type: "send", message: proof() });
        else if (data?.type === "closed" && data.closeReason === TOKEN_REFUSED) {
          this.terminate(); // It would knock again and again.
          askForToken();
        }
      });
    }
    if (message?.type !== "set_server") return post.call(this, message, ...rest);
    appIsThere.then(() => post.call(this, { ...message, server: socketAddress("/") }, ...rest));
  };
}
