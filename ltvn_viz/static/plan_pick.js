// What is under the pointer on the map: the nearest node, edge, door or box, in the plan and in the 3D scene alike. What
// lies at one place is spread there, so that each can be taken.

const NEAR_PX = 12;
const FINGER_PX = 24;
const EDGE_LATER_PX = 2; // A node is taken before an edge that is no nearer than this.
const MIDDLE = 0.15; // So much of an edge at each end belongs to its nodes.
const FAN_PX = 24;
const HEADING_PX = 12; // The tips of spread headings are no nearer to each other, though the headings may be equal.
const LANES_PX = [3, 6]; // The edges of a bundle lie so far apart, the fewer the wider,
const BUNDLE_PX = 120; // and together they are no wider than this, if that leaves enough for each.
const ALONG_SINE = 0.08; // Edges whose directions differ by less, and that lie so near, are on one line.
const ALONG_PX = 5;
const [MOST_ROUNDS, STILL_RAD] = [2000, 1e-4]; // Headings push each other aside so often, until they hardly move.
const HELD_PART = 0.3; // An edge that was spread under the pointer is taken before any other edge.
const SAME_PX = 8; // Nodes that are no farther apart stand at one place.
const NODE_HEIGHT_M = 0.14; // As `NODE_Z` in `layers`.
const DOOR_HEIGHT_M = 1.5;

const fan = new Map(); // Nodes at one place, spread while the pointer is there -> tip of the heading, seen from the node.
const bundle = new Map(); // Edges on one line, spread while the pointer is there -> pixels to the right of its own line.
let reach = NEAR_PX; // As far as the pointer points, which may be a finger.
let hovered = null; // What a click would take: { kind, id, distance }.

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
    if (ends === null) continue;
    const away = distanceTo(ends, px, py);
    const isHeld = bundle.has(source * EDGE_KEY + target);
    yield { kind: "edge", id: [source, target], distance: isHeld ? HELD_PART * away : away + EDGE_LATER_PX };
  }
}

function nearest(px, py) {
  if (plan.view === null || plan.view.aim !== "") return null;
  let found = null;
  for (const each of candidates(px, py)) {
    if (each.distance <= reach && (found === null || each.distance < found.distance)) found = each;
  }
  return found;
}

// Returns whether other nodes are spread than before.
function spreadFan(px, py) {
  const away = (id) => Math.hypot(...between(id, px, py));
  const isStill = [...fan].some(([id, tip]) => plan.nodes.has(id) && away(id) < Math.hypot(...tip) + reach);
  if (isStill) return false;
  const before = fan.size;
  fan.clear();
  if (shows3d() || hidden.has("nodes")) return before > 0;
  const near = [...plan.nodes.values()].filter(({ id }) => away(id) < reach).sort((a, b) => away(a.id) - away(b.id));
  const here = near.filter((node) => isSamePlace(node, near[0]));
  if (here.length > 1 && (reach === NEAR_PX || nearest(px, py)?.kind === "node")) spreadHeadings(here);
  return before > 0 || fan.size > 0;
}

// Headings that are nearly the same push each other aside until all tips can be told apart.
function spreadHeadings(nodes) {
  const radius = Math.max(FAN_PX, (nodes.length * HEADING_PX) / 6);
  const least = HEADING_PX / radius;
  const sorted = nodes.map(({ id, yaw }) => ({ id, yaw: yaw - 2 * Math.PI * Math.floor(yaw / (2 * Math.PI)) }));
  sorted.sort((one, other) => one.yaw - other.yaw);
  let pushed = Infinity;
  for (let round = 0; round < MOST_ROUNDS && pushed > STILL_RAD; round++) {
    pushed = 0;
    for (const [k, one] of sorted.entries()) {
      const isLast = k + 1 === sorted.length;
      const other = sorted[isLast ? 0 : k + 1];
      const push = Math.max(0, least - (other.yaw + (isLast ? 2 * Math.PI : 0) - one.yaw)) / 2;
      pushed = Math.max(pushed, push);
      one.yaw -= push;
      other.yaw += push;
    }
  }
  for (const { id, yaw } of sorted) fan.set(id, [radius * Math.cos(yaw), -radius * Math.sin(yaw)]);
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
  const own = isEdge ? found.id[0] * EDGE_KEY + found.id[1] : 0;
  const alike = isEdge ? edgesAlong(edgeEnds(...found.id), px, py) : [];
  if (alike.length > 1) {
    const step = Math.min(Math.max(BUNDLE_PX / alike.length, LANES_PX[0]), LANES_PX[1]);
    // The edge that was found stays below the pointer, and the others lie to its right and left in turn.
    [own, ...alike.filter((key) => key !== own)].forEach((key, k) => {
      const lane = k % 2 === 1 ? (k + 1) / 2 : -k / 2;
      const { source, target } = plan.edges.get(key);
      bundle.set(key, lane * step + beside(edgeEnds(source, target), px, py) + LANE_PX);
    });
  }
  return before > 0 || bundle.size > 0;
}

// How far to the right of a line a point lies.
function beside([x0, y0, x1, y1], px, py) {
  return ((px - x0) * (y0 - y1) + (py - y0) * (x1 - x0)) / (Math.hypot(x1 - x0, y1 - y0) || 1);
}

// The edges that pass by a point on the picture in the direction of a line.
function edgesAlong(line, px, py) {
  const found = [];
  for (const [key, { source, target }] of plan.edges) {
    const ends = edgeEnds(source, target);
    if (ends !== null && distanceTo(ends, px, py) < Math.max(NEAR_PX, distanceTo(line, px, py) + 1) && isAlong(ends, line)) found.push(key);
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
    drawSome(context, [ends], shadeOf(edge?.p ?? 0), 2.5);
  }
}

function between(id, px, py) {
  const { x, y } = plan.nodes.get(id);
  const [ax, ay] = planPoint(x, y);
  return [ax - px, ay - py];
}

function drawFan(context) {
  const nodes = [...fan.keys()].map((id) => plan.nodes.get(id)).filter((node) => node !== undefined);
  if (nodes.length === 0) return;
  for (const { source, target, p } of plan.edges.values()) {
    if (fan.has(source) && fan.has(target)) drawSome(context, [edgeEnds(source, target)], shadeOf(p), 1.5);
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

function keyOf({ kind, id }) {
  return `${kind} ${id}`;
}

function hover(found, px = 0, py = 0) {
  const card = byId("ltvn-card");
  const key = found === null ? "" : keyOf(found);
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
