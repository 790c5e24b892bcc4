// The pad on the screen: four arrows and a stop for mouse and touch, who drives, and the help. Text from elsewhere is
// only ever set as text.

const CAPS = { forward: "▲", left: "◀", stop: "■", right: "▶", backward: "▼" };

const BY_TOUCH = matchMedia("(hover: none) and (pointer: coarse)");

const pad = {};

function element(tag, className, text = "") {
  const made = document.createElement(tag);
  made.className = className;
  made.textContent = text;
  return made;
}

function button(className, text, label) {
  const made = element("button", className, text);
  made.type = "button";
  made.tabIndex = -1;
  made.setAttribute("aria-label", label);
  // A focused button would be clicked by keys that are meant for the robot.
  made.addEventListener("mousedown", (event) => event.preventDefault());
  made.addEventListener("contextmenu", (event) => event.preventDefault());
  return made;
}

function arrow(direction) {
  const verb = direction === "left" || direction === "right" ? "turn" : "drive";
  const made = button(`ltvn-key ltvn-${direction}`, CAPS[direction], `${verb} ${direction}`);
  const source = `pad ${direction}`;
  made.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    event.preventDefault();
    made.setPointerCapture(event.pointerId);
    hold(source, direction);
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    made.addEventListener(end, () => drop(source));
  }
  return made;
}

function stopKey() {
  const made = button("ltvn-key ltvn-stop", CAPS.stop, "stop the robot");
  made.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    ask("stop");
  });
  return made;
}

function helpCard() {
  const card = element("dl", "ltvn-help");
  card.hidden = true;
  card.addEventListener("click", toggleHelp);
  return card;
}

function showCaps() {
  pad.help.replaceChildren();
  for (const [codes, text] of KEYMAP.help) {
    pad.help.append(element("dt", "", codes.map(capOf).join(" or ")), element("dd", "", text));
  }
  showStatus();
}

function toggleHelp() {
  pad.help.hidden = !pad.help.hidden;
}

function takeOverButton() {
  const made = button("ltvn-text-button", "Take over", "take over driving");
  made.tabIndex = 0;
  made.addEventListener("click", () => ask("take_over"));
  return made;
}

function helpButton() {
  const made = button("ltvn-text-button ltvn-keys-help", "Keys", "show or hide the keys");
  made.tabIndex = 0;
  made.addEventListener("click", toggleHelp);
  return made;
}

function nameOfDriver(id) {
  return `Page ${id}`;
}

function whyLatched() {
  if (seat.reason === "input lost") return "Input lost";
  if (seat.stoppedBy !== null && seat.stoppedBy !== seat.you) {
    return seat.reason === "taken over" ? "Taken over" : `${nameOfDriver(seat.stoppedBy)} stopped the robot`;
  }
  return "Stopped";
}

// What the robot does, or why it does nothing; empty while it is for a person to drive.
function whatTheRobotDoes() {
  if (activity.goal !== null) return `The robot ${activity.mode === "paused" ? "is paused on its path" : "drives"} to node ${activity.goal}`;
  if (activity.mode === "building") return "The map is being built; the robot is stopped";
  if (activity.mode === "replay") return "This is a recording; the robot is stopped";
  return activity.openLoop ? "A recorded drive is played; nothing can be driven" : "";
}

function status() {
  if (!seat.isOpen) return ["lost", "No connection to the robot"];
  const does = whatTheRobotDoes();
  if (isWatching()) {
    const what = activity.goal === null ? `${nameOfDriver(seat.driver)} drives` : `${does}, as ${nameOfDriver(seat.driver)} asked`;
    return ["other", `${what}${isHolding() || refusedBy ? ": take over first" : ""}`];
  }
  if (!seat.armed && isHolding()) return ["lost", `${whyLatched()}: ${BY_TOUCH.matches ? "let go" : "release the keys"} to go on`];
  if (does !== "" && activity.goal === null) return ["free", does];
  const typing = isTyping(document.activeElement);
  const how = BY_TOUCH.matches ? "an arrow" : ownLetters("W A S D or an arrow");
  if (activity.goal !== null) return ["robot", `${does}. ${typing ? "Click beside the field, then hold" : "Hold"} ${how} to take over`];
  if (typing) return ["free", "Typing: click beside the field to drive"];
  if (isInPanels()) return ["free", "Keys are in the panel: Esc to drive"];
  if (isHolding()) return ["you", "You drive"];
  if (activity.story) return ["free", "The story continues: the robot waits for the next part"];
  return [seat.driver === seat.you ? "you" : "free", `Hold ${how} to drive`];
}

function showStatus() {
  const [kind, text] = status();
  pad.root.dataset.state = kind;
  pad.status.textContent = text;
  document.documentElement.toggleAttribute("data-ltvn-keys-elsewhere", isInPanels());
  pad.takeOver.hidden = kind !== "other";
  pad.lastKey.textContent = capOf(lastKey);
  for (const [direction, made] of Object.entries(pad.arrows)) {
    made.classList.toggle("ltvn-held", [...held.values()].includes(direction));
  }
}

function showPad() {
  pad.root = element("aside", "ltvn-pad");
  pad.root.setAttribute("aria-label", "driving");
  pad.help = helpCard();
  pad.status = element("div", "ltvn-status");
  pad.status.setAttribute("role", "status");
  pad.lastKey = element("kbd", "ltvn-last-key");
  pad.takeOver = takeOverButton();
  pad.arrows = Object.fromEntries(KEYMAP.allDirections.map((direction) => [direction, arrow(direction)]));
  const line = element("div", "ltvn-line");
  line.append(pad.status, pad.lastKey);
  const keys = element("div", "ltvn-keys");
  keys.append(...Object.values(pad.arrows), stopKey());
  const buttons = element("div", "ltvn-line");
  buttons.append(pad.takeOver, helpButton());
  pad.root.append(pad.help, keys, line, buttons);
  byId("ltvn-cockpit").append(pad.root);
  watchers.push(showStatus);
  for (const name of ["focusin", "focusout"]) addEventListener(name, () => setTimeout(showStatus));
  showCaps();
}
