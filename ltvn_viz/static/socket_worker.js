// The page's connection to the robot, in a thread of its own. So the server hears that the page is there however long
// the page draws, and while it is behind another one, where a page's own timers run once a second. A page that was
// frozen, or does not answer its worker any more, is not there.

const HERE_MS = 50;
const RECONNECT_MS = 500;
const ASK_MS = 1000;
const HUNG_MS = 10000;

let socket = null;
let isFrozen = false;
let answered = performance.now();

function connect(address) {
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => {
    if (data instanceof ArrayBuffer) postMessage({ type: "picture", jpeg: data }, [data]);
    else postMessage({ type: "heard", text: data });
  };
  socket.onclose = () => {
    postMessage({ type: "lost" });
    setTimeout(connect, RECONNECT_MS, address);
  };
}

function send(text) {
  if (socket !== null && socket.readyState === WebSocket.OPEN) socket.send(text);
}

function sayHere() {
  if (!isFrozen && performance.now() - answered < HUNG_MS) send('{"type":"here"}');
}

onmessage = ({ data }) => {
  answered = performance.now();
  if (data.type === "connect") connect(data.address);
  else if (data.type === "send") send(data.text);
  else if (data.type === "freeze") isFrozen = data.frozen;
};
setInterval(sayHere, HERE_MS);
setInterval(postMessage, ASK_MS, { type: "ask" });
