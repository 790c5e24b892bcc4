// The map from above under hand: it fits the floor to the space, moves, grows, says what is under the pointer, and takes
// the nearest node or edge. The 3D scene is one press away; the rule for what a click takes is the same there.

const NEAR_PX = 12;
const EDGE_LATER_PX = 2; // A node is taken before an edge that is no nearer than this.
const MIDDLE = 0.15; // So much of an edge at each end belongs to its nodes.
const FAN_PX = 24;
const BUNDLE_PX = 6;
const ALONG_SINE = 0.08; // Edges whose directions differ by less, and that lie so near, are on one line.
const ALONG_PX = 5;
const HELD_PART = 0.3; // An edge that was spread under the pointer counts as nearer than another edge.
const SAME_PX = 6; // Nodes that are no farther apart stand at one place.
const MOVED_PX = { mouse: 4, pen: 6, touch: 10 };
const MARGIN_PX = 14;
const MOST_SCALE = 600;
const FOLLOW_SHARE = 0.3; // The robot is kept out of so much of the view at each side.
const STORED_VIEW = "ltvn-view";
const STORED_FOLDS = "ltvn-folds";
const BY_PROCESSOR = /swiftshader|llvmpipe|softpipe|software|basic render/i;
const NODE_HEIGHT_M = 0.14; // As `NODE_Z` in `layers`.
const DOOR_HEIGHT_M = 1.5;

const fan = new Set(); // Nodes at one place whose headings are spread while the pointer is there.
const bundle = new Map(); // Edges on one line, spread while the pointer is there -> lane, counted from 0.
let hovered = null; // What a click would take: { kind, id, distance }.
let isFitted = true; // Until a person moves the view.
let isFollowing = true;
const pointers = new Map(); // Pointers that are down -> where they are.
let drag = null; // Where the one pointer went down, and whether it moved since.

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

// The 3D scene is drawn by a graphics card, or not at all well.
const isDrawnByProcessor = (() => {
  const probe = document.createElement("canvas").getContext("webgl2");
  const named = probe?.getExtension("WEBGL_debug_renderer_info");
  const name = named ? String(probe.getParameter(named.UNMASKED_RENDERER_WEBGL)) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return probe === null || BY_PROCESSOR.test(name);
})();

// Smoothing can only be chosen when viser asks for its canvas; it costs a processor most of its time.
function smoothOnlyWhereQuick() {
  if (!isDrawnByProcessor) return;
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
  send({ type: "view", scene: shows3d() });
}

// ---- The view

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

// ---- What is under the pointer

// Where a point of the floor is on the picture: from above, or in viser's scene, by its camera.
function pointOnScreen(x, y, z = NODE_HEIGHT_M) {
  if (!shows3d()) return planPoint(x, y);
  const { camera, nodeRefFromName } = window.__viserMutable;
  const root = nodeRefFromName[""]?.matrixWorld.elements ?? [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  const seen = [root, camera.matrixWorldInverse.elements, camera.projectionMatrix.elements].reduce(times, [x, y, z, 1]);
  if (seen[3] <= 0) return [-1e6, -1e6];
  return [((seen[0] / seen[3] + 1) / 2) * size.width, ((1 - seen[1] / seen[3]) / 2) * size.height];
}

function times([x, y, z, w], m) {
  return [0, 1, 2, 3].map((row) => m[row] * x + m[row + 4] * y + m[row + 8] * z + m[row + 12] * w);
}

function distanceTo([x0, y0, x1, y1], px, py, least = MIDDLE) {
  const [dx, dy] = [x1 - x0, y1 - y0];
  const along = Math.min(Math.max(((px - x0) * dx + (py - y0) * dy) / (dx * dx + dy * dy || 1), least), 1 - least);
  return Math.hypot(px - x0 - along * dx, py - y0 - along * dy);
}

function* candidates(px, py) {
  const { doors, boxes } = plan.view;
  for (const { door, x, y, label, is_open } of hidden.has("doors") ? [] : doors) {
    const [ax, ay] = pointOnScreen(x, y, DOOR_HEIGHT_M);
    yield { kind: "door", id: door, distance: Math.hypot(px - ax, py - ay), label, is_open };
  }
  for (const { number, x, y } of boxes) {
    const [ax, ay] = pointOnScreen(x, y);
    yield { kind: "box", id: number, distance: Math.hypot(px - ax, py - ay) };
  }
  for (const node of hidden.has("nodes") ? [] : plan.nodes.values()) {
    const tip = tipOf(node, pointOnScreen);
    yield { kind: "node", id: node.id, distance: distanceTo([...pointOnScreen(node.x, node.y), ...tip], px, py, 0) };
  }
  for (const { source, target } of hidden.has("edges") ? [] : plan.edges.values()) {
    const ends = edgeEnds(source, target, pointOnScreen);
    const part = bundle.has(source * EDGE_KEY + target) ? HELD_PART : 1;
    if (ends !== null) yield { kind: "edge", id: [source, target], distance: part * distanceTo(ends, px, py) + EDGE_LATER_PX };
  }
}

function nearest(px, py) {
  if (plan.view === null || plan.view.aim !== "") return null;
  let found = null;
  for (const each of candidates(px, py)) {
    if (each.distance <= NEAR_PX && (found === null || each.distance < found.distance)) found = each;
  }
  return found;
}

// Returns whether other nodes are spread than before.
function spreadFan(px, py) {
  const away = (id) => Math.hypot(...between(id, px, py));
  const isStill = [...fan].some((id) => plan.nodes.has(id) && away(id) < FAN_PX + NEAR_PX);
  if (isStill) return false;
  const before = fan.size;
  fan.clear();
  if (shows3d() || hidden.has("nodes")) return before > 0;
  const near = [...plan.nodes.values()].filter(({ id }) => away(id) < NEAR_PX).sort((a, b) => away(a.id) - away(b.id));
  const here = near.filter((node) => isSamePlace(node, near[0]));
  if (here.length > 1) here.forEach(({ id }) => fan.add(id));
  return before > 0 || fan.size > 0;
}

function isSamePlace(one, other) {
  return Math.hypot(one.x - other.x, one.y - other.y) * eye.scale < SAME_PX;
}

// Edges on one line, as those between the same two places: side by side they can be told from each other. Returns
// whether other edges are spread than before.
function spreadBundle(found, px, py) {
  const isEdge = found?.kind === "edge" && !shows3d();
  if (isEdge && bundle.has(found.id[0] * EDGE_KEY + found.id[1])) return false;
  const before = bundle.size;
  bundle.clear();
  const alike = isEdge ? edgesAlong(edgeEnds(...found.id), px, py) : [];
  if (alike.length > 1) alike.forEach((key, lane) => bundle.set(key, lane));
  return before > 0 || bundle.size > 0;
}

// The edges that pass by a point on the picture in the direction of a line.
function edgesAlong(line, px, py) {
  const found = [];
  for (const [key, { source, target }] of plan.edges) {
    const ends = edgeEnds(source, target);
    if (ends !== null && distanceTo(ends, px, py) < NEAR_PX && isAlong(ends, line)) found.push(key);
  }
  return found;
}

function isAlong([x0, y0, x1, y1], [a0, b0, a1, b1]) {
  const [length, other] = [Math.hypot(x1 - x0, y1 - y0), Math.hypot(a1 - a0, b1 - b0)];
  const [dx, dy, ex, ey] = [(x1 - x0) / length, (y1 - y0) / length, (a1 - a0) / other, (b1 - b0) / other];
  const aside = Math.abs((x0 - a0) * ey - (y0 - b0) * ex); // How far the one begins beside the line of the other.
  return dx * ex + dy * ey > 0 && Math.abs(dx * ey - dy * ex) < ALONG_SINE && aside < ALONG_PX;
}

function drawBundle(context) {
  for (const key of bundle.keys()) {
    const edge = plan.edges.get(key);
    const ends = edge === undefined ? null : edgeEnds(edge.source, edge.target);
    drawSome(context, [ends], RIM, 4);
    drawSome(context, [ends], shades[Math.round((edge?.p ?? 0) * (SHADES - 1))], 2.5);
  }
}

function between(id, px, py) {
  const { x, y } = plan.nodes.get(id);
  const [ax, ay] = planPoint(x, y);
  return [ax - px, ay - py];
}

function drawFan(context) {
  const nodes = [...fan].map((id) => plan.nodes.get(id)).filter((node) => node !== undefined);
  if (nodes.length === 0) return;
  for (const { source, target, p } of plan.edges.values()) {
    if (fan.has(source) && fan.has(target)) drawSome(context, [edgeEnds(source, target)], shades[Math.round(p * (SHADES - 1))], 1.5);
  }
  drawDots(context, nodes, RIM, 1.3);
  drawDots(context, nodes, COLOURS.node);
  context.fillStyle = COLOURS.node;
  context.beginPath();
  for (const node of nodes) {
    const [x, y] = tipOf(node);
    context.moveTo(x + 4, y);
    context.arc(x, y, 4, 0, 7);
  }
  context.fill();
}

const SAYS = {
  put_box: "Click: the box is put here",
  point_on_plan: "Click: the node's place on the floor plan",
};

function clickText(found) {
  if (found.kind === "door") return `Click: ${found.is_open ? "close" : "open"} the door`;
  if (found.kind === "box") return "Click: choose this box, then its new place";
  if (isWatching()) return whyNot();
  if (plan.view.asks || found.kind === "edge") return "Click: ask about it";
  return activity.mode === "manual" ? "Click: the robot drives here" : "Click: choose this goal";
}

function wordsOf(found) {
  if (found.kind === "door") return [`${found.label}`, found.is_open ? "open" : "closed"];
  if (found.kind === "box") return [`Box ${found.id}`, ""];
  if (found.kind === "node") {
    const node = plan.nodes.get(found.id);
    return [`Node ${node.id}`, roomAt(node.x, node.y)];
  }
  const [from, to] = found.id.map((id) => plan.nodes.get(id));
  const edge = edgeOf(...found.id);
  const length = Math.hypot(to.x - from.x, to.y - from.y);
  return [`Edge ${found.id.join(" → ")}`, `p ${edge.p.toFixed(2)}, ${length.toFixed(2)} m${edge.acts ? ", needs an action" : ""}`];
}

function hover(found, px = 0, py = 0) {
  const card = byId("ltvn-card");
  const key = found === null ? "" : `${found.kind} ${found.id}`;
  const canvas = shows3d() ? document.querySelector("#root canvas[data-engine]") : byId("ltvn-plan");
  if (canvas !== null) canvas.style.cursor = plan.view?.aim ? "crosshair" : found === null ? "" : "pointer";
  hovered = found;
  if (card.dataset.about !== key) {
    card.dataset.about = key;
    sheets.top.redraw();
    card.hidden = found === null;
    if (found !== null) fillCard(card, found);
  }
  if (found !== null) {
    const box = byId("ltvn-plan").getBoundingClientRect();
    card.style.left = `${box.left + Math.min(px + 16, size.width - card.offsetWidth - 4)}px`;
    card.style.top = `${box.top + Math.min(py + 16, size.height - card.offsetHeight - 4)}px`;
  }
}

async function fillCard(card, found) {
  const [title, more] = wordsOf(found);
  const image = found.kind === "node" ? element("img", "") : null;
  card.replaceChildren(...(image === null ? [] : [image]), element("b", "", title), element("span", "", more), element("i", "", clickText(found)));
  if (image === null) return;
  image.alt = "";
  const answer = await fetchWithToken(`/seen/${found.id}.jpg`).catch(() => null);
  if (!answer?.ok) return image.remove();
  image.src = URL.createObjectURL(await answer.blob());
  image.addEventListener("load", () => URL.revokeObjectURL(image.src), { once: true });
}

// ---- Clicks and movements

const ASKED = { door: "door", box: "aim_box", node: "pick", edge: "pick_edge" };

function takeAt(px, py) {
  if (plan.view === null) return;
  if (plan.view.aim !== "") {
    if (!shows3d()) ask(plan.view.aim, planPlace(px, py));
    return;
  }
  const found = nearest(px, py);
  if (found !== null) ask(ASKED[found.kind], found.id);
}

function placeIn({ clientX, clientY }) {
  const box = byId("ltvn-plan").getBoundingClientRect();
  return [clientX - box.left, clientY - box.top];
}

function onPlanDown(event) {
  if (event.button !== 0 && event.button !== 2) return;
  const at = placeIn(event);
  pointers.set(event.pointerId, at);
  event.currentTarget.setPointerCapture(event.pointerId);
  drag = { at, isMoved: pointers.size > 1 || event.button === 2, pinch: pinchOf() };
}

function onPlanMove(event) {
  const at = placeIn(event);
  if (!pointers.has(event.pointerId)) return overPlan(...at);
  const before = pointers.get(event.pointerId);
  pointers.set(event.pointerId, at);
  if (!drag.isMoved && Math.hypot(at[0] - drag.at[0], at[1] - drag.at[1]) <= MOVED_PX[event.pointerType]) return;
  drag.isMoved = true;
  hover(null);
  if (pointers.size === 1) return moveView(eye.x - (at[0] - before[0]) / eye.scale, eye.y + (at[1] - before[1]) / eye.scale, eye.scale);
  const pinch = pinchOf();
  if (drag.pinch !== null && pinch !== null) zoomPlan(pinch.length / drag.pinch.length, [pinch.x, pinch.y], [drag.pinch.x, drag.pinch.y]);
  drag.pinch = pinch;
}

function onPlanUp(event) {
  const isClick = event.type === "pointerup" && pointers.size === 1 && drag !== null && !drag.isMoved;
  pointers.delete(event.pointerId);
  if (pointers.size === 0) drag = null;
  // A finger does not hover: its first tap spreads what lies at one place, and the next one takes of it.
  if (isClick && (event.pointerType !== "touch" || !overPlan(...placeIn(event)))) takeAt(...placeIn(event));
}

function pinchOf() {
  if (pointers.size !== 2) return null;
  const [[x0, y0], [x1, y1]] = [...pointers.values()];
  return { length: Math.max(Math.hypot(x1 - x0, y1 - y0), 1), x: (x0 + x1) / 2, y: (y0 + y1) / 2 };
}

// Returns whether several things were spread that lay at one place.
function overPlan(px, py) {
  if (plan.view === null) return false;
  const isOtherFan = spreadFan(px, py);
  const isOtherBundle = spreadBundle(nearest(px, py), px, py);
  if (isOtherFan || isOtherBundle) sheets.top.redraw();
  hover(nearest(px, py), px, py);
  return (isOtherFan && fan.size > 0) || (isOtherBundle && bundle.size > 0);
}

// A finger that was lifted leaves as well, and what it spread is for its next tap.
function onPlanLeave({ pointerType }) {
  if (pointerType === "touch") return;
  fan.clear();
  bundle.clear();
  hover(null);
  sheets.top.redraw();
}

function onWheel(event) {
  event.preventDefault();
  zoomPlan(1.0015 ** -event.deltaY, placeIn(event));
  overPlan(...placeIn(event));
}

const PLAN_KEYS = {
  ArrowLeft: () => moveView(eye.x - 40 / eye.scale, eye.y, eye.scale),
  ArrowRight: () => moveView(eye.x + 40 / eye.scale, eye.y, eye.scale),
  ArrowUp: () => moveView(eye.x, eye.y + 40 / eye.scale, eye.scale),
  ArrowDown: () => moveView(eye.x, eye.y - 40 / eye.scale, eye.scale),
  Equal: () => zoomPlan(1.25),
  Minus: () => zoomPlan(0.8),
  Digit0: () => wholeFloor(),
};

// Returns whether the key was for the plan, which has the keyboard while Tab has put the focus there.
function onPlanKey(event) {
  const does = PLAN_KEYS[event.code];
  if (document.activeElement !== byId("ltvn-plan") || !isInPanels() || does === undefined) return false;
  swallow(event);
  does();
  return true;
}

function wholeFloor() {
  isFitted = isFollowing = true;
  fit();
  showTools();
}

// ---- The keys beside the plan

function showTools() {
  byId("ltvn-whole").setAttribute("aria-pressed", String(isFitted));
  byId("ltvn-follow").setAttribute("aria-pressed", String(isFollowing));
}

function fold(name) {
  const folds = new Set(stored(STORED_FOLDS, "").split(" ").filter(Boolean));
  if (!folds.delete(name)) folds.add(name);
  store(STORED_FOLDS, [...folds].join(" "));
  showFolds();
}

function showFolds() {
  const folds = stored(STORED_FOLDS, "").split(" ").filter(Boolean);
  document.documentElement.dataset.ltvnFolds = folds.join(" ");
  for (const name of ["cockpit", "panel"]) byId(`ltvn-fold-${name}`).setAttribute("aria-pressed", String(folds.includes(name)));
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
  "ltvn-fold-cockpit": () => fold("cockpit"),
  "ltvn-fold-panel": () => fold("panel"),
};

function onSceneMove(event) {
  if (!shows3d() || event.buttons !== 0) return;
  if (event.target.matches?.("#root canvas[data-engine]")) overPlan(...placeIn(event));
  else if (hovered !== null) hover(null);
}

function onSceneClick(event) {
  if (shows3d() && event.target.matches?.("#root canvas[data-engine]") && !isDrag(event)) takeAt(...placeIn(event));
}

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
  root.addEventListener("dblclick", (event) => zoomPlan(2, placeIn(event)));
  root.addEventListener("contextmenu", (event) => event.preventDefault());
  addEventListener("pointermove", onSceneMove, true);
  addEventListener("click", onSceneClick, true);
  for (const [id, does] of Object.entries(TOOLS)) byId(id).addEventListener("click", does);
  document.addEventListener("visibilitychange", frameSoon);
  new ResizeObserver(measurePlan).observe(root);
  watchers.push(() => seat.isOpen || (tellView.told = false), () => {
    if (seat.isOpen && !tellView.told) tellView();
    tellView.told = seat.isOpen;
  });
  showFolds();
  showTools();
  show3d(stored(STORED_VIEW, isDrawnByProcessor ? "plan" : "3d") === "3d");
}
