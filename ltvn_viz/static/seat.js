// The connection to the server, and what the server tells of the driver's seat and the robot.

const seat = { isOpen: false, isSilent: false, you: null, driver: null, epoch: 0, armed: false, reason: null, stoppedBy: null };
const activity = { mode: "driving", goal: null, story: false }; // What is under way, and the node that the robot drives to by itself.
const watchers = []; // Functions without arguments, called whenever something to be shown has changed.
let socket = null; // A worker that holds the connection.
let early = []; // Actions asked for before the first connection stands, which are sent once it does; null afterwards.
let refusedBy = null; // Who drives, when an action was refused for that reason.

function changed() {
  watchers.forEach((watcher) => watcher());
}

function send(message) {
  if (seat.isOpen) socket.postMessage({ type: "send", text: JSON.stringify(message) });
}

// Later, while the connection is lost, nothing waits: the world may be another when it is back.
function sendEarly() {
  early?.forEach(send);
  early = null;
}

function tellHeld(message) {
  if (seat.isOpen) socket.postMessage({ type: "hold", message });
}

function ask(action, value = null) {
  refusedBy = null;
  const message = { type: "action", action, value };
  if (early === null) send(message);
  else early.push(message);
}

function connect() {
  socket = new Worker(URL.createObjectURL(new Blob([SOCKET_WORKER], { type: "text/javascript" })));
  socket.onmessage = ({ data }) => {
    if (data.type === "picture") drawPictures(data.jpeg);
    else if (data.type === "heard") hear(JSON.parse(data.text));
    else if (data.type === "lost") lose();
    else if (data.type === "silence") hearSilence(data.isSilent);
    else if (data.type === "refused") askForToken();
    else socket.postMessage({ type: "answer" });
  };
  for (const name of ["freeze", "resume"]) {
    document.addEventListener(name, () => socket.postMessage({ type: "freeze", frozen: name === "freeze" }));
  }
  socket.postMessage({ type: "connect", address: socketAddress("/drive"), proof: JSON.stringify(proof()) });
}

function lose() {
  Object.assign(seat, { isOpen: false, you: null, driver: null, armed: false });
  changed();
}

function hearSilence(isSilent) {
  seat.isSilent = isSilent;
  changed();
}

function isWatching() {
  return seat.isOpen && seat.driver !== null && seat.driver !== seat.you;
}

function hear({ type, ...fields }) {
  if (type === "state") {
    const isNewEpoch = !seat.isOpen || fields.epoch !== seat.epoch;
    Object.assign(seat, fields, { isOpen: true });
    // Tell the truth about what is held; only "nothing" arms this page in the new epoch.
    if (isNewEpoch) report();
    openLink();
    sendEarly();
  } else if (type === "moment") {
    return hearMoment(fields);
  } else if (type === "activity") {
    Object.assign(activity, fields);
  } else if (type === "refused") {
    refusedBy = fields.driver;
  }
  changed();
}
