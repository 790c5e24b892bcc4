// The view of the map: it fits the whole floor to the space until a person moves it, and follows the robot. The 3D scene
// is one press away. The keys beside the map.

const MARGIN_PX = 14;
const MOST_SCALE = 1500;
const FOLLOW_SHARE = 0.3; // The robot is kept out of so much of the view at each side.
const STORED_VIEW = "ltvn-view";
const STORED_FOLDS = "ltvn-folds";
const BY_PROCESSOR = /swiftshader|llvmpipe|softpipe|software|basic render/i;

let isFitted = true; // Until a person moves the view.
let isFollowing = true;

function stored(name, otherwise) {
  try {
    return localStorage.getItem(name) ?? otherwise;
  } catch {
    return otherwise; // A browser that stores nothing.
  }
}

function store(name, value) {
  try {
    localStorage.setItem(name, value);
  } catch {
    // Then it lasts as long as the page.
  }
}

function isDrawnByProcessor() {
  const probe = document.createElement("canvas").getContext("webgl2");
  const named = probe?.getExtension("WEBGL_debug_renderer_info");
  const name = named ? String(probe.getParameter(named.UNMASKED_RENDERER_WEBGL)) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return BY_PROCESSOR.test(name);
}

// Smoothing can only be chosen when viser asks for its canvas; it costs a processor most of its time.
function smoothOnlyWhereQuick() {
  if (!isDrawnByProcessor()) return;
  const get = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return get.call(this, kind, kind === "webgl2" ? { ...options, antialias: false } : options);
  };
}

function shows3d() {
  return document.documentElement.dataset.ltvnView === "3d";
}

function show3d(is3d) {
  document.documentElement.dataset.ltvnView = is3d ? "3d" : "plan";
  byId("ltvn-3d").textContent = is3d ? "Plan" : "3D";
  byId("ltvn-3d").title = is3d ? "Show the map from above" : "Show the scene in 3D";
  hover(null);
  tellView();
  measurePlan();
}

function tellView() {
  send({ type: "view", scene: shows3d(), camera: !document.hidden && byId("ltvn-pictures").checkVisibility() });
}

function fit() {
  if (plan.view === null || size.width < 2) return;
  const [x0, y0, x1, y1] = extent();
  const room = [size.width - 2 * MARGIN_PX, size.height - 2 * MARGIN_PX];
  const scale = Math.min(room[0] / Math.max(x1 - x0, 0.5), room[1] / Math.max(y1 - y0, 0.5), MOST_SCALE);
  look((x0 + x1) / 2, (y0 + y1) / 2, Math.max(scale, 1));
}

function fitUntilMoved() {
  if (isFitted) fit();
}

function look(x, y, scale) {
  Object.assign(eye, { x, y, scale });
  tellEye();
  moveRobot();
  frameSoon();
}

// For whoever drives this page by a script: where in the window a place of the map is.
function tellEye() {
  byId("ltvn-plan").dataset.eye = `${eye.x} ${eye.y} ${eye.scale}`;
}

function moveView(x, y, scale, follows = () => false) {
  isFitted = false;
  Object.assign(eye, { x, y, scale });
  isFollowing &&= follows();
  look(x, y, scale);
  showTools();
}

// What was below one point of the picture is below another one afterwards; the same unless fingers moved it.
// Who looks closer at a place away from the robot does not follow it any more, as the place would not stay there.
function zoomPlan(factor, at = null, from = at) {
  const [px, py] = at ?? [size.width / 2, size.height / 2];
  const [x, y] = planPlace(...(from ?? [px, py]));
  const scale = Math.min(Math.max(eye.scale * factor, 1), MOST_SCALE);
  fan.clear(); // What lies at one place is another thing now.
  bundle.clear();
  const follows = () => at === null || (plan.robot !== null && robotBeyond().every((gone) => gone === 0));
  moveView(x - (px - size.width / 2) / scale, y + (py - size.height / 2) / scale, scale, follows);
}

// The view moves along before the robot leaves its middle; a view of the whole floor need not.
function followRobot() {
  if (!isFollowing || isFitted || drag !== null) return;
  const [dx, dy] = robotBeyond();
  if (dx === 0 && dy === 0) return;
  Object.assign(eye, { x: eye.x + dx / eye.scale, y: eye.y - dy / eye.scale });
  tellEye();
  frameSoon();
}

// How far the robot is beyond the middle of the view, in pixels.
function robotBeyond() {
  const [px, py] = planPoint(...plan.robot);
  const beyond = (at, of) => Math.max(0, at - of * (1 - FOLLOW_SHARE)) + Math.min(0, at - of * FOLLOW_SHARE);
  return [beyond(px, size.width), beyond(py, size.height)];
}

function measurePlan() {
  const box = byId("ltvn-plan").getBoundingClientRect();
  if (box.width < 2 || (box.width === size.width && box.height === size.height)) return frameSoon();
  Object.assign(size, { width: box.width, height: box.height });
  for (const sheet of Object.values(sheets)) sheet.redraw();
  fitUntilMoved();
  moveRobot();
}

function showTools() {
  byId("ltvn-whole").setAttribute("aria-pressed", String(isFitted));
  byId("ltvn-follow").setAttribute("aria-pressed", String(isFollowing));
}

// The columns at the sides fold away; the browser remembers it.
function showFolds(toggled = "") {
  const folds = new Set(stored(STORED_FOLDS, "").split(" ").filter(Boolean));
  if (toggled !== "" && !folds.delete(toggled)) folds.add(toggled);
  store(STORED_FOLDS, [...folds].join(" "));
  document.documentElement.dataset.ltvnFolds = [...folds].join(" ");
  for (const key of document.querySelectorAll("[data-fold]")) key.setAttribute("aria-pressed", String(folds.has(key.dataset.fold)));
  tellView();
}

const TOOLS = {
  "ltvn-in": () => zoomPlan(1.4),
  "ltvn-out": () => zoomPlan(1 / 1.4),
  "ltvn-whole": wholeFloor,
  "ltvn-follow": () => {
    isFollowing = !isFollowing;
    showTools();
    moveRobot();
  },
  "ltvn-colours": () => document.documentElement.toggleAttribute("data-ltvn-colours"),
  "ltvn-3d": () => {
    store(STORED_VIEW, shows3d() ? "plan" : "3d");
    show3d(!shows3d());
  },
};

function listenToPlan() {
  const root = byId("ltvn-plan");
  robotCanvas.className = "ltvn-robot";
  robotCanvas.hidden = true;
  root.prepend(...["ground", "path", "map", "top"].map((name) => sheets[name].canvas), robotCanvas);
  root.addEventListener("pointerdown", onPlanDown);
  root.addEventListener("pointermove", onPlanMove);
  for (const kind of ["pointerup", "pointercancel"]) root.addEventListener(kind, onPlanUp);
  root.addEventListener("pointerleave", onPlanLeave);
  root.addEventListener("wheel", onWheel, { passive: false });
  root.addEventListener("contextmenu", (event) => event.preventDefault());
  addEventListener("pointermove", onSceneMove, true);
  addEventListener("click", onSceneClick, true);
  for (const [id, does] of Object.entries(TOOLS)) byId(id).addEventListener("click", does);
  for (const key of document.querySelectorAll("[data-fold]")) key.addEventListener("click", () => showFolds(key.dataset.fold));
  for (const does of [frameSoon, tellView]) document.addEventListener("visibilitychange", does);
  new ResizeObserver(measurePlan).observe(root);
  showFolds();
  showTools();
  show3d(stored(STORED_VIEW, "plan") === "3d");
}
