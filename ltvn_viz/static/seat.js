// The connection to the server, and what the server tells of the driver's seat and the robot.

const seat = { isOpen: false, isSilent: false, you: null, driver: null, epoch: 0, armed: false, reason: null, stoppedBy: null, unheard: null };
const activity = { mode: "manual", goal: null, story: false, openLoop: false }; // What is under way, and the node that the robot drives to by itself.
const watchers = []; // Functions without arguments, called whenever something to be shown has changed.
let socket = null; // A worker that holds the connection, from the moment when the page's elements are there.
let refusedBy = null; // Who drives, when an action was refused for that reason.

function changed() {
  watchers.forEach((watcher) => watcher());
}

function send(message) {
  if (seat.isOpen) socket.postMessage({ type: "send", text: JSON.stringify(message) });
}

function tellHeld(message) {
  if (seat.isOpen) socket.postMessage({ type: "hold", message });
}

// The worker keeps a press for a moment while the connection is lost; a press of a key, only before the first connection.
function ask(action, value = null, isKey = false) {
  refusedBy = null;
  seat.unheard = null;
  socket.postMessage({ type: "ask", message: { type: "action", action, value }, isKey });
}

function connect() {
  socket = new Worker(URL.createObjectURL(new Blob([SOCKET_WORKER], { type: "text/javascript" })));
  socket.onmessage = ({ data }) => {
    if (data.type === "picture") drawPictures(data.jpeg);
    else if (data.type === "heard") hear(JSON.parse(data.text));
    else if (data.type === "lost") lose(data.inVain);
    else if (data.type === "silence") hearSilence(data.isSilent);
    else if (data.type === "refused") askForToken();
    else if (data.type === "unheard") sayUnheard(`“${KEYMAP.labels[data.action]}”`);
    else socket.postMessage({ type: "answer" });
  };
  for (const name of ["freeze", "resume"]) {
    document.addEventListener(name, () => socket.postMessage({ type: "freeze", frozen: name === "freeze" }));
  }
  appIsThere.then(() => {
    socket.postMessage({ type: "connect", address: socketAddress("/drive"), proof: JSON.stringify(proof()) });
  });
}

function lose(inVain) {
  if (inVain === SOCKETS_IN_VAIN) sayInVain();
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

const HEARD = {
  robot: hearRobot,
  view: hearView,
  path: (fields) => hearPath(fields, "path"),
  course: (fields) => hearPath(fields, "course"),
};

function hear({ type, ...fields }) {
  if (type === "state") {
    const isNew = !seat.isOpen;
    const isNewEpoch = isNew || fields.epoch !== seat.epoch;
    Object.assign(seat, fields, { isOpen: true });
    if (isNew) tellView();
    // Tell the truth about what is held; only "nothing" arms this page in the new epoch.
    if (isNewEpoch) report();
    openLink();
  } else if (type === "moment") {
    return hearMoment(fields);
  } else if (type in HEARD) {
    return HEARD[type](fields);
  } else if (type === "activity") {
    Object.assign(activity, fields);
  } else if (type === "refused") {
    refusedBy = fields.driver;
  }
  changed();
}
