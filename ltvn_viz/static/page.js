// The page's name at the server: a secret that no other page is told. The page's two sockets, viser's and ours, both
// carry it, so that whatever is clicked in viser's panels is judged by the seat of the page where it was clicked.

const PAGE_KEY = Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");

function socketAddress(path) {
  return `${location.origin.replace(/^http/, "ws")}${path}?page=${PAGE_KEY}`;
}

// viser's socket lives in a worker, which is told where to connect by this one message.
function nameViserSocket() {
  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (message, ...rest) {
    const isAddress = message?.type === "set_server";
    return post.call(this, isAddress ? { ...message, server: socketAddress("/") } : message, ...rest);
  };
}
