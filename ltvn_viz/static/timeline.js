// The timeline at the foot of the page: buttons, the cursor, and what pointer, wheel and keys do on the strip. The
// moment itself is the server's; here is only what a person asked for a moment ago, until the server has followed.

const SPEEDS = [25, 50, 100, 200, 400, 800];
const SEND_EVERY_MS = 60;
const SNAP = 5; // Pixels: a click so near to a mark means the mark.
const WISH_MS = 700; // So long the cursor stays where a person put it, before the server has followed.
const KEY_STEP_MS = 1000;

const dock = { wish: null, wishedAt: 0, pointers: new Map(), pinch: 0, sentAt: 0, timer: null, isPointed: false, byKey: [] };

function dockButton(action, sign, label, code = "") {
  const made = element("button", "ltvn-time-button", sign);
  made.type = "button";
  made.setAttribute("aria-label", label);
  made.title = label;
  if (code !== "") dock.byKey.push([made, label, code]);
  if (action !== null) made.dataset.ltvnAction = action;
  // A button that takes the keyboard would keep it from the robot.
  made.addEventListener("mousedown", (event) => event.preventDefault());
  return made;
}

function viewButton(sign, label, act) {
  const made = dockButton(null, sign, label);
  made.addEventListener("click", act);
  return made;
}

function speedList() {
  const made = element("select", "ltvn-time-speed");
  made.setAttribute("aria-label", "speed of playing");
  made.title = "How fast the recording, or the past, is played";
  for (const speed of SPEEDS) made.append(new Option(`${speed / 100}×`, speed));
  made.addEventListener("change", () => {
    ask("speed", Number(made.value));
    made.blur();
  });
  return made;
}

function showTimeline() {
  dock.root = byId("timeline-dock");
  dock.root.classList.add("ltvn-time");
  dock.play = dockButton("play", "▶", "play");
  dock.speed = speedList();
  dock.clock = element("output", "ltvn-time-clock");
  dock.live = dockButton("show_now", "● Live", "back to now: end looking back");
  dock.live.classList.add("ltvn-time-live");
  dock.queries = [dockButton("query_before", "|◀", "previous query", "Minus"), dockButton("query_after", "▶|", "next query", "Equal")];
  const events = [dockButton("event_before", "‹", "previous event", "Semicolon"), dockButton("event_after", "›", "next event", "Quote")];
  events.forEach((each) => each.classList.add("ltvn-time-step"));
  const middle = () => stripWidth() / 2;
  const zooms = element("span", "ltvn-time-zoom");
  zooms.append(
    viewButton("−", "zoom out", () => zoom(1 / 2, middle())),
    viewButton("+", "zoom in", () => zoom(2, middle())),
    viewButton("⤢", "show the whole run", showWhole),
    viewButton("?", "what the signs mean", toggleSigns),
  );
  dock.row = element("div", "ltvn-time-row");
  dock.row.append(dock.queries[0], events[0], dock.play, events[1], dock.queries[1], dock.speed, dock.clock, dock.live, zooms);
  dock.root.append(dock.row, stripBox(), signs());
  new ResizeObserver(drawSoon).observe(dock.box);
  nameDockKeys();
  showMoment(true);
}

function nameDockKeys() {
  for (const [made, label, code] of dock.byKey) made.title = `${label} (${capOf(code)})`;
}

function stripBox() {
  dock.box = element("div", "ltvn-time-track");
  dock.names = element("div", "ltvn-time-names");
  dock.names.setAttribute("aria-hidden", "true");
  dock.names.append(...["queries", ...TIMELINE.lanes].map((name) => element("div", "", name)));
  view.canvas = element("canvas", "ltvn-time-strip");
  dock.cursor = element("i", "ltvn-time-cursor");
  dock.hint = element("div", "ltvn-time-hint");
  dock.hint.hidden = true;
  Object.assign(view.canvas, { tabIndex: 0 });
  view.canvas.setAttribute("role", "slider");
  view.canvas.setAttribute("aria-label", "moment on show");
  listenToStrip();
  dock.box.append(view.canvas, dock.cursor);
  const whole = element("div", "ltvn-time-box");
  whole.append(dock.names, dock.box, dock.hint);
  return whole;
}

// A line for each lane, named as beside the strip: the same sign may mean a query in one and an attempt in another.
function signs() {
  dock.signs = element("div", "ltvn-time-signs");
  dock.signs.hidden = true;
  dock.signs.append(signLine("queries", [...Object.values(TIMELINE.bars), TIMELINE.underWay]));
  TIMELINE.lanes.forEach((name, lane) => {
    dock.signs.append(signLine(name, Object.values(TIMELINE.kinds).filter((kind) => kind.lane === lane)));
  });
  return dock.signs;
}

function signLine(name, styles) {
  const line = element("div", "ltvn-time-sign-line");
  line.append(element("b", "", `${name}:`));
  for (const { sign, colour, words } of styles) {
    const made = element("span", "", ` ${words}`);
    const drawn = element("b", "", sign);
    drawn.style.color = colour;
    made.prepend(drawn);
    line.append(made);
  }
  return line;
}

function toggleSigns() {
  dock.signs.hidden = !dock.signs.hidden;
}

// Where the cursor stands: where a person put it just now, else where the server says.
function shownTime() {
  const isWaiting = dock.wish !== null && performance.now() - dock.wishedAt < WISH_MS;
  if (!isWaiting || Math.abs(dock.wish - moment.at) < 60) dock.wish = null;
  return dock.wish ?? moment.at;
}

function showMoment(isOther = false) {
  if (dock.root === undefined) return;
  if (isOther) Object.assign(view, { from: 0, to: null });
  if (moment.playing || moment.now) followMoment();
  const isPast = !moment.now && !moment.replay;
  dock.root.dataset.state = moment.now ? "now" : moment.replay ? "replay" : "past";
  dock.play.textContent = moment.playing ? "❚❚" : "▶";
  dock.play.setAttribute("aria-label", moment.playing ? "pause" : "play");
  dock.play.disabled = moment.now;
  dock.play.title = moment.now
    ? "This is now. Click into the strip to look back, then play what happened."
    : `${moment.playing ? "pause" : "play"}${moment.replay ? ` (${capOf("KeyP")})` : ""}`;
  dock.live.hidden = moment.replay;
  dock.live.disabled = moment.now;
  dock.live.title = moment.now ? "You see the robot as it is now" : "back to now: end looking back";
  dock.speed.value = String(Math.round(moment.speed * 100));
  const behind = isPast ? `, ${clockText(moment.length - moment.at)} ago` : "";
  const [at, length] = [clockText(shownTime()), clockText(moment.length)];
  dock.clock.textContent = moment.now ? at : `${at} of ${length}${behind}`;
  dock.queries[0].disabled = !strip.queries.some((each) => each.from < moment.at - 1);
  dock.queries[1].disabled = moment.now || !(isPast || strip.queries.some((each) => each.from > moment.at));
  const canvas = view.canvas;
  canvas.setAttribute("aria-valuemin", "0");
  canvas.setAttribute("aria-valuemax", String(Math.round(moment.length / 1000)));
  canvas.setAttribute("aria-valuenow", String(Math.round(moment.at / 1000)));
  readMoment(`${at} of ${length}${moment.now ? ", now" : ""}`);
  // A run that goes on is drawn anew when it has grown by a pixel.
  const grown = (moment.length - view.drawnLength) * stripWidth() / Math.max(moment.length, 1);
  if (isOther || (view.to === null && Math.abs(grown) >= 1)) drawSoon();
  placeCursor();
}

// Who has the strip under the keys, or hears it, is told what a pointer there is.
function readMoment(words) {
  const isRead = document.activeElement === view.canvas;
  const lines = isRead ? linesAt(shownTime(), timeAt(SNAP) - timeAt(0)) : [];
  view.canvas.setAttribute("aria-valuetext", [words, ...lines].join("; "));
  if (isRead && view.canvas.matches(":focus-visible") && !dock.isPointed) showHint(columnOf(shownTime()));
}

function placeCursor() {
  const column = columnOf(shownTime());
  dock.cursor.hidden = column < -1 || column > stripWidth() + 1;
  dock.cursor.style.transform = `translateX(${column.toFixed(1)}px)`;
}

function seekTo(time) {
  const wish = Math.round(Math.min(Math.max(0, time), moment.length));
  Object.assign(dock, { wish, wishedAt: performance.now() });
  placeCursor();
  const wait = dock.sentAt + SEND_EVERY_MS - performance.now();
  clearTimeout(dock.timer);
  dock.timer = setTimeout(() => {
    dock.sentAt = performance.now();
    ask("seek", wish);
  }, Math.max(0, wait));
}

function columnUnder(event) {
  return event.clientX - view.canvas.getBoundingClientRect().left;
}

function listenToStrip() {
  const canvas = view.canvas;
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    event.preventDefault();
    canvas.setPointerCapture(event.pointerId);
    dock.pointers.set(event.pointerId, columnUnder(event));
    if (dock.pointers.size === 1) seekTo(snapped(columnUnder(event)));
    else dock.pinch = pinchWidth();
    pointAt(columnUnder(event));
  });
  canvas.addEventListener("pointermove", onStripMove);
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    canvas.addEventListener(end, (event) => dock.pointers.delete(event.pointerId));
  }
  canvas.addEventListener("pointerleave", endHint);
  canvas.addEventListener("focus", () => showMoment());
  canvas.addEventListener("blur", endHint);
  canvas.addEventListener("wheel", onStripWheel, { passive: false });
  canvas.addEventListener("keydown", onStripKey);
}

// A click near the end of a recording shows its end, because what happened last is counted only there.
function snapped(column) {
  const [time, reach] = [timeAt(column), timeAt(SNAP) - timeAt(0)];
  if (moment.replay && moment.length - time < reach) return moment.length;
  return nearestMark(time, reach) ?? time;
}

function pinchWidth() {
  const [one, other] = [...dock.pointers.values()];
  return Math.max(10, Math.abs(one - other));
}

function onStripMove(event) {
  const column = columnUnder(event);
  pointAt(column);
  if (!dock.pointers.has(event.pointerId)) return;
  dock.pointers.set(event.pointerId, column);
  if (dock.pointers.size === 1) return seekTo(timeAt(column));
  const [one, other] = [...dock.pointers.values()];
  const width = pinchWidth();
  zoom(width / dock.pinch, (one + other) / 2);
  dock.pinch = width;
}

function pointAt(column) {
  dock.isPointed = true;
  showHint(column);
}

function endHint() {
  dock.isPointed = false;
  dock.hint.hidden = true;
}

function showHint(column) {
  const reach = timeAt(SNAP) - timeAt(0);
  const time = timeAt(column);
  const lines = [clockText(time), ...linesAt(time, reach)];
  dock.hint.replaceChildren(...lines.map((line) => element("div", "", line)));
  dock.hint.hidden = false;
  const least = dock.box.offsetLeft;
  const most = least + stripWidth() - dock.hint.offsetWidth;
  const middle = least + column - dock.hint.offsetWidth / 2;
  dock.hint.style.left = `${Math.min(Math.max(least, middle), Math.max(least, most))}px`;
}

function onStripWheel(event) {
  event.preventDefault();
  const sideways = event.shiftKey ? event.deltaY : event.deltaX;
  if (Math.abs(sideways) > Math.abs(event.deltaY) || event.shiftKey) pan(sideways);
  else zoom(Math.exp(-event.deltaY / 300), columnUnder(event));
}

function onStripKey(event) {
  const step = event.shiftKey ? KEY_STEP_MS / 10 : KEY_STEP_MS;
  const from = shownTime();
  const acts = {
    ArrowLeft: () => seekTo(from - step),
    ArrowRight: () => seekTo(from + step),
    Home: () => seekTo(0),
    End: () => (moment.replay ? seekTo(moment.length) : ask("show_now")),
    PageUp: () => ask("query_before"),
    PageDown: () => ask("query_after"),
    Enter: () => ask("play"),
    ArrowUp: () => zoom(1.5, columnOf(from)),
    ArrowDown: () => zoom(1 / 1.5, columnOf(from)),
  };
  if (!(event.key in acts) || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  acts[event.key]();
  showMoment();
}
