// The page's connection to the robot, in a thread of its own. So the server hears that the page is there however long
// the page draws, and while it is behind another one, where a page's own timers run once a second.

const HERE_MS = 50;
const RECONNECT_MS = 500;

let socket = null;

function connect(address) {
  socket = new WebSocket(address);
  socket.onmessage = (event) => postMessage(event.data);
  socket.onclose = () => {
    postMessage(null);
    setTimeout(connect, RECONNECT_MS, address);
  };
}

function send(text) {
  if (socket !== null && socket.readyState === WebSocket.OPEN) socket.send(text);
}

onmessage = ({ data: { address, text } }) => (address === undefined ? send(text) : connect(address));
setInterval(send, HERE_MS, '{"type":"here"}');
