// Pointers, wheel and keys on the map: they move it, make it grow, and take what is under them.

const MOVED_PX = { mouse: 4, pen: 6, touch: 10 };

const pointers = new Map(); // Pointers that are down -> where they are.
let drag = null; // Where the one pointer went down, and whether it moved since.

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

function placeIn({ clientX, clientY, pointerType }) {
  reach = pointerType === "touch" ? FINGER_PX : NEAR_PX;
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
  if (isClick && (event.pointerType !== "touch" || isToldAfterTap(...placeIn(event)))) takeAt(...placeIn(event));
}

// A finger does not hover: it takes the nearest thing, but where several lie at one place the first tap spreads them, and
// tells of one, which the next tap takes.
function isToldAfterTap(px, py) {
  const found = nearest(px, py);
  return (found !== null && keyOf(found) === byId("ltvn-card").dataset.about) || !overPlan(px, py);
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
  const found = nearest(px, py);
  const isOtherBundle = spreadBundle(found, px, py);
  if (isOtherFan || isOtherBundle) sheets.top.redraw();
  hover(isOtherBundle ? nearest(px, py) : found, px, py);
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

function onSceneMove(event) {
  if (!shows3d() || event.buttons !== 0) return;
  if (event.target.matches?.("#root canvas[data-engine]")) overPlan(...placeIn(event));
  else if (hovered !== null) hover(null);
}

function onSceneClick(event) {
  if (shows3d() && event.target.matches?.("#root canvas[data-engine]") && !isDrag(event)) takeAt(...placeIn(event));
}
