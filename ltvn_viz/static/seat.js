// The connection to the server, and the driver's seat as the server tells it.

const RECONNECT_MS = 500;

const seat = { isOpen: false, you: null, driver: null, epoch: 0, armed: false, reason: null, stoppedBy: null };
const watchers = []; // Functions without arguments, called whenever something to be shown has changed.
let socket = null;
let refusedBy = null; // Who drives, when an action was refused for that reason.

function changed() {
  watchers.forEach((watcher) => watcher());
}

function send(message) {
  if (socket !== null && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function ask(action, id = null) {
  refusedBy = null;
  send({ type: "action", action, id });
}

function connect() {
  socket = new WebSocket(`${location.origin.replace(/^http/, "ws")}/drive`);
  socket.onmessage = (event) => hear(JSON.parse(event.data));
  socket.onclose = () => {
    Object.assign(seat, { isOpen: false, you: null, driver: null, armed: false });
    changed();
    setTimeout(connect, RECONNECT_MS);
  };
}

function hear({ type, ...fields }) {
  if (type === "state") {
    const isNewEpoch = !seat.isOpen || fields.epoch !== seat.epoch;
    Object.assign(seat, fields, { isOpen: true });
    // Tell the truth about what is held; only "nothing" arms this page in the new epoch.
    if (isNewEpoch) report();
    openLink();
  } else if (type === "refused") {
    refusedBy = fields.driver;
  }
  changed();
}
