// How the map from above is drawn: on stacked canvases, each drawn anew only when what it shows changed.
//
// A drawing is a generator that yields between slices, so that a map of 50,000 edges keeps no key waiting. While it is
// drawn anew, the old picture is moved and scaled to where the new one will be.

const SLICE_MS = 8;
const EDGES_A_SLICE = 400;
const RIMMED = 6000; // Edges beyond which a dark rim costs more than it shows.
const SHADES = 16;
const LANE_PX = 1.5; // An edge lies so far to its right, so that the two directions are two lines.
const NODE_PX = 3.2; // At most; from far away a dot is smaller, down to half of it.
const NODE_M = 0.06;
const TICK_PER_DOT = 2.5; // How long the line is that shows the heading of a node.
const WEDGE_M = 1.2;
const ROBOT_PX = 260; // Side of the robot's own small canvas.
const FADE_S = 3; // As in `run_moment.py`.
const RIM = COLOURS.background;
const shades = Array.from({ length: SHADES }, (_, k) => rampColour(RAMP, k / (SHADES - 1)));

const eye = { x: 0, y: 0, scale: 40 }; // The middle of the view in metres, and pixels a metre.
const size = { width: 1, height: 1 };
const hidden = new Set(); // What the legend hides.

function rampColour(ramp, share) {
  const at = share * (ramp.length - 1);
  const low = Math.min(Math.floor(at), ramp.length - 2);
  return `rgb(${ramp[low].map((part, k) => Math.round(part + (at - low) * (ramp[low + 1][k] - part))).join(",")})`;
}

function shadeOf(p) {
  return shades[Math.round(p * (SHADES - 1))];
}

function planPoint(x, y) {
  return [size.width / 2 + (x - eye.x) * eye.scale, size.height / 2 - (y - eye.y) * eye.scale];
}

function planPlace(px, py) {
  return [eye.x + (px - size.width / 2) / eye.scale, eye.y - (py - size.height / 2) / eye.scale];
}

class Sheet {
  constructor(draw) {
    this.draw = draw;
    this.canvas = document.createElement("canvas");
    this.shown = this.canvas.getContext("bitmaprenderer"); // It takes a picture over, where others copy it for each frame.
    this.back = null; // A picture that is not yet complete.
    this.isDue = true;
    this.job = null;
    this.drawn = null; // Where the eye was when this picture was drawn.
  }

  redraw() {
    this.isDue = true;
    frameSoon();
  }

  // Returns whether there is more to draw.
  step(until) {
    const isElsewhere = this.drawn === null || ["x", "y", "scale"].some((each) => this.drawn[each] !== eye[each]);
    if (this.job === null && (this.isDue || isElsewhere)) this.begin();
    while (this.job !== null) {
      if (this.job.steps.next().done) this.finish();
      else if (performance.now() > until) break;
    }
    this.place();
    return this.job !== null || this.isDue;
  }

  begin() {
    const ratio = Math.min(devicePixelRatio, 2);
    this.back = new OffscreenCanvas(Math.round(size.width * ratio), Math.round(size.height * ratio));
    const context = this.back.getContext("2d");
    context.scale(ratio, ratio);
    this.isDue = false;
    this.job = { eye: { ...eye }, size: { ...size }, steps: this.draw(context) };
  }

  finish() {
    if (this.job.eye.scale === eye.scale || this.drawn === null || !this.isDue) {
      this.shown.transferFromImageBitmap(this.back.transferToImageBitmap());
      Object.assign(this.canvas.style, { width: `${this.job.size.width}px`, height: `${this.job.size.height}px` });
      this.drawn = this.job.eye;
    }
    this.job = null;
  }

  place() {
    if (this.drawn === null) return;
    const grown = eye.scale / this.drawn.scale;
    const x = (this.drawn.x - eye.x) * eye.scale + (1 - grown) * size.width / 2;
    const y = (eye.y - this.drawn.y) * eye.scale + (1 - grown) * size.height / 2;
    const transform = grown === 1 && x === 0 && y === 0 ? "" : `translate(${x}px, ${y}px) scale(${grown})`;
    if (this.canvas.style.transform !== transform) this.canvas.style.transform = transform;
  }
}

const sheets = { ground: new Sheet(drawGround), path: new Sheet(drawPath), map: new Sheet(drawMap), top: new Sheet(drawTop) };

function* drawGround(context) {
  const { floor, sheet, solids, rooms } = plan.view ?? { floor: null, sheet: null, solids: [], rooms: [] };
  if (floor === null && sheet === null) drawGrid(context);
  context.imageSmoothingQuality = "medium";
  if (floor !== null) plan.floorPicture = pictures.get(floor.picture) || plan.floorPicture;
  if (floor !== null && plan.floorPicture !== null) {
    const [[x0, y1], [x1, y0]] = [planPoint(floor.low[0], floor.high[1]), planPoint(floor.high[0], floor.low[1])];
    context.globalAlpha = 0.6;
    context.drawImage(plan.floorPicture, x0, y1, x1 - x0, y0 - y1);
    context.globalAlpha = 1;
  }
  yield;
  if (sheet !== null && pictures.get(sheet.picture)) {
    const [[x, y, yaw], [width, height]] = [sheet.pose, sheet.size];
    context.save();
    context.translate(...planPoint(x, y));
    context.rotate(-yaw);
    context.scale(eye.scale, eye.scale);
    context.drawImage(pictures.get(sheet.picture), -width / 2, -height / 2, width, height);
    context.restore();
  }
  for (const [x, y, yaw, width, depth] of solids) {
    context.save();
    context.translate(...planPoint(x, y));
    context.rotate(-yaw);
    context.fillStyle = "#8a6d4b";
    context.strokeStyle = "#f1e3cf";
    const [w, d] = [Math.max(width * eye.scale, 4), Math.max(depth * eye.scale, 4)];
    context.fillRect(-w / 2, -d / 2, w, d);
    context.strokeRect(-w / 2, -d / 2, w, d);
    context.restore();
  }
  if (!hidden.has("rooms")) drawRooms(context, rooms);
}

function drawGrid(context) {
  const every = eye.scale < 12 ? 5 : 1;
  const [[left, top], [right, bottom]] = [planPlace(0, 0), planPlace(size.width, size.height)];
  context.strokeStyle = "#2a2d33";
  context.beginPath();
  for (let x = Math.ceil(left / every) * every; x <= right; x += every) {
    context.moveTo(planPoint(x, 0)[0], 0);
    context.lineTo(planPoint(x, 0)[0], size.height);
  }
  for (let y = Math.ceil(bottom / every) * every; y <= top; y += every) {
    context.moveTo(0, planPoint(0, y)[1]);
    context.lineTo(size.width, planPoint(0, y)[1]);
  }
  context.stroke();
}

function drawRooms(context, rooms) {
  context.font = "600 13px system-ui, sans-serif";
  context.textAlign = "center";
  for (const [name, x0, y0, x1, y1] of rooms) {
    const width = (x1 - x0) * eye.scale;
    if (context.measureText(name).width > width - 6) continue;
    const [x, y] = planPoint((x0 + x1) / 2, y1);
    write(context, name, x, y + 22, "rgba(230, 233, 240, 0.85)");
  }
}

function write(context, text, x, y, colour) {
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeStyle = RIM;
  context.strokeText(text, x, y);
  context.fillStyle = colour;
  context.fillText(text, x, y);
}

function* drawPath(context) {
  if (!hidden.has("path")) {
    drawWay(context, plan.course, COLOURS.course, 1.5);
    yield;
    drawWay(context, plan.path, COLOURS.trajectory, 2.5);
  }
}

const JUMP_M = 1.5; // A robot that is farther away at once was carried.

function drawWay(context, points, colour, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.lineJoin = "round";
  context.beginPath();
  let [x0, y0] = [Infinity, Infinity];
  for (const [x, y] of points) {
    context[Math.hypot(x - x0, y - y0) < JUMP_M ? "lineTo" : "moveTo"](...planPoint(x, y));
    [x0, y0] = [x, y];
  }
  context.stroke();
}

// The two ends of an edge in pixels, in its lane; null where an end is not in the map.
function edgeEnds(source, target, pointOf = planPoint, isSpread = true) {
  const [from, to] = [plan.nodes.get(source), plan.nodes.get(target)];
  if (from === undefined || to === undefined) return null;
  const isTurn = isSpread && fan.has(source) && fan.has(target); // Both stand at one place: the edge joins their headings.
  const [x0, y0] = isTurn ? tipOf(from, pointOf) : pointOf(from.x, from.y);
  const [x1, y1] = isTurn ? tipOf(to, pointOf) : pointOf(to.x, to.y);
  const length = Math.hypot(x1 - x0, y1 - y0) || 1;
  const lane = (isSpread ? bundle.get(source * EDGE_KEY + target) : undefined) ?? LANE_PX;
  const [ox, oy] = [(-(y1 - y0) / length) * lane, ((x1 - x0) / length) * lane];
  return [x0 + ox, y0 + oy, x1 + ox, y1 + oy];
}

function isInView([x0, y0, x1, y1]) {
  return Math.max(x0, x1) > -20 && Math.min(x0, x1) < size.width + 20 && Math.max(y0, y1) > -20 && Math.min(y0, y1) < size.height + 20;
}

function* drawMap(context) {
  const shaded = Array.from({ length: SHADES }, () => []);
  const acting = [];
  if (!hidden.has("edges")) {
    for (const { source, target, p, acts } of plan.edges.values()) {
      const ends = edgeEnds(source, target, planPoint, false);
      if (ends === null || !isInView(ends)) continue;
      (acts ? acting : shaded[Math.round(p * (SHADES - 1))]).push(ends);
    }
    yield;
    const isRimmed = shaded.reduce((sum, each) => sum + each.length, 0) < RIMMED;
    if (isRimmed) for (const lines of shaded) yield* drawLines(context, lines, RIM, 3.2);
    for (const [k, lines] of shaded.entries()) yield* drawLines(context, lines, shades[k], 0.8 + (1.2 * k) / SHADES);
    context.setLineDash([5, 4]);
    yield* drawLines(context, acting, COLOURS.action, 2.5);
    context.setLineDash([]);
  }
  if (!hidden.has("nodes")) yield* drawNodes(context);
}

function* drawLines(context, lines, colour, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  for (let from = 0; from < lines.length; from += EDGES_A_SLICE) {
    context.beginPath();
    for (const [x0, y0, x1, y1] of lines.slice(from, from + EDGES_A_SLICE)) {
      context.moveTo(x0, y0);
      context.lineTo(x1, y1);
    }
    context.stroke();
    yield;
  }
}

function* drawNodes(context) {
  const shown = [...plan.nodes.values()].filter(({ x, y }) => isInView([...planPoint(x, y), ...planPoint(x, y)]));
  for (let from = 0; from < shown.length; from += EDGES_A_SLICE) {
    for (const [colour, grown] of [[RIM, 1.3], [null, 0]]) {
      for (const isExit of [0, 1]) {
        const some = shown.slice(from, from + EDGES_A_SLICE).filter((node) => Boolean(node.isExit) === Boolean(isExit));
        drawDots(context, some, colour ?? (isExit ? COLOURS.action : COLOURS.node), grown, dotPx(), false);
      }
    }
    yield;
  }
}

function dotPx() {
  return Math.min(Math.max(NODE_M * eye.scale, NODE_PX / 2), NODE_PX);
}

function drawDots(context, nodes, colour, grown = 0, radius = dotPx(), isSpread = true) {
  context.fillStyle = context.strokeStyle = colour;
  context.lineWidth = Math.min(radius / 2, 1.4) + 2 * grown;
  context.lineCap = "round";
  context.beginPath();
  for (const node of nodes) {
    context.moveTo(...planPoint(node.x, node.y));
    context.lineTo(...tipOf(node, planPoint, isSpread));
  }
  context.stroke();
  context.beginPath();
  for (const { x, y } of nodes) {
    const [px, py] = planPoint(x, y);
    context.moveTo(px + radius + grown, py);
    context.arc(px, py, radius + grown, 0, 7);
  }
  context.fill();
}

// Where the short line ends that shows the heading of a node. Several nodes at one place differ in it alone.
function tipOf({ id, x, y, yaw }, pointOf = planPoint, isSpread = true) {
  const [px, py] = pointOf(x, y);
  const length = TICK_PER_DOT * dotPx();
  const [dx, dy] = (isSpread ? fan.get(id) : undefined) ?? [length * Math.cos(yaw), -length * Math.sin(yaw)];
  return [px + dx, py + dy];
}

function* drawTop(context) {
  if (plan.view === null) return;
  const { blocked, came, went, plan: nodes, strokes, marks, labels, selected, ghost, ghosts, doors, boxes, sheet } = plan.view;
  drawSome(context, blocked.map(([source, target]) => edgeEnds(source, target)), COLOURS.removed, 3.5, "went");
  for (const [rows, colour, name] of [[went, COLOURS.removed, "went"], [came, COLOURS.added, "came"]]) {
    for (const [x0, y0, x1, y1, age] of rows) {
      context.globalAlpha = Math.max(0.1, 1 - age / FADE_S);
      drawSome(context, [[...planPoint(x0, y0), ...planPoint(x1, y1)]], colour, 4, name);
    }
    context.globalAlpha = 1;
  }
  yield;
  const known = nodes.map((id) => plan.nodes.get(id)).filter((node) => node !== undefined);
  if (!hidden.has("plan")) drawWay(context, known.map(({ x, y }) => [x, y]), COLOURS.plan, 4);
  drawHalo(context, selected, "#fff");
  for (const [x0, y0, x1, y1, colour] of strokes) drawSome(context, [[...planPoint(x0, y0), ...planPoint(x1, y1)]], colour, 4.5);
  for (const [id, colour] of marks) if (plan.nodes.has(id)) drawDots(context, [plan.nodes.get(id)], colour, 0, 5);
  for (const [x, y, yaw] of ghost === null ? ghosts : [ghost, ...ghosts]) drawGhost(context, x, y, yaw);
  drawNode(context, plan.view.here, COLOURS.localised);
  drawGoal(context);
  for (const door of doors) drawDoor(context, door);
  for (const { x, y } of boxes) drawHandle(context, x, y);
  for (const [x, y] of sheet?.marks ?? []) drawHandle(context, x, y);
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "center";
  for (const [x, y, text] of labels) write(context, text, planPoint(x, y)[0], planPoint(x, y)[1] - 8, "#fff");
  drawBundle(context);
  drawFan(context);
  if (hovered?.kind === "edge") drawHalo(context, hovered.id, COLOURS.accent);
  else if (hovered?.kind === "node") drawDots(context, [plan.nodes.get(hovered.id)].filter(Boolean), COLOURS.accent, 1, 5);
}

function drawSome(context, lines, colour, width, name = "") {
  if (hidden.has(name)) return;
  context.lineCap = "butt";
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  for (const line of lines) {
    if (line === null) continue;
    context.moveTo(line[0], line[1]);
    context.lineTo(line[2], line[3]);
  }
  context.stroke();
}

function drawHalo(context, edge, colour) {
  const ends = edge === null ? null : edgeEnds(...edge);
  if (ends === null) return;
  drawSome(context, [ends], colour, 8);
  const known = edgeOf(...edge);
  drawSome(context, [ends], known === undefined ? COLOURS.target : shadeOf(known.p), 4);
}

function drawNode(context, id, colour) {
  const node = plan.nodes.get(id);
  if (node === undefined) return;
  drawDots(context, [node], RIM, 1.5, 5);
  drawDots(context, [node], colour, 0, 5);
}

function drawGoal(context) {
  const node = plan.nodes.get(plan.view.goal);
  if (node === undefined || hidden.has("goal")) return;
  drawNode(context, node.id, COLOURS.goal);
  const [x, y] = planPoint(node.x, node.y);
  context.fillStyle = COLOURS.goal;
  context.strokeStyle = RIM;
  context.lineWidth = 2;
  context.beginPath();
  context.arc(x, y - 24, 10, Math.PI * 0.8, Math.PI * 0.2);
  context.lineTo(x, y);
  context.closePath();
  context.stroke();
  context.fill();
  context.fillStyle = RIM;
  context.beginPath();
  context.arc(x, y - 24, 3.5, 0, 7);
  context.fill();
}

function drawGhost(context, x, y, yaw) {
  const [px, py] = planPoint(x, y);
  const radius = Math.max(plan.view.radius * eye.scale, 6);
  context.globalAlpha = 0.6;
  context.fillStyle = COLOURS.predicted;
  context.beginPath();
  context.arc(px, py, radius, 0, 7);
  context.fill();
  context.globalAlpha = 1;
  drawSome(context, [[px, py, px + 1.6 * radius * Math.cos(yaw), py - 1.6 * radius * Math.sin(yaw)]], COLOURS.predicted, 3);
}

function drawDoor(context, { x, y, along_x, width_m, is_open }) {
  if (hidden.has("doors")) return;
  const half = width_m / 2;
  const [from, to] = along_x ? [[x - half, y], [x + half, y]] : [[x, y - half], [x, y + half]];
  context.setLineDash(is_open ? [3, 4] : []);
  drawSome(context, [[...planPoint(...from), ...planPoint(...to)]], is_open ? COLOURS.added : COLOURS.removed, is_open ? 3 : 6);
  context.setLineDash([]);
}

function drawHandle(context, x, y) {
  const [px, py] = planPoint(x, y);
  context.fillStyle = COLOURS.accent;
  context.strokeStyle = "#fff";
  context.lineWidth = 1.5;
  context.beginPath();
  context.arc(px, py, 6, 0, 7);
  context.fill();
  context.stroke();
}

// The robot and what it sees, on a small canvas that moves and turns: it is drawn anew only if it is larger or looks
// farther. Between two messages the browser moves it on, so it glides however late a message is.
const robotCanvas = document.createElement("canvas");
let robotYaw = 0; // The one that is shown: it goes on beyond a turn, as the browser takes the way between two numbers.

function moveRobot(glides = false) {
  const isShown = plan.robot !== null && plan.view !== null && !hidden.has("robot");
  robotCanvas.hidden = !isShown;
  if (!isShown) return;
  followRobot();
  const [x, y, yaw] = plan.robot;
  const [px, py] = planPoint(x, y);
  robotYaw += Math.atan2(Math.sin(yaw - robotYaw), Math.cos(yaw - robotYaw));
  robotCanvas.classList.toggle("ltvn-glides", glides);
  robotCanvas.style.transform = `translate(${px - ROBOT_PX / 2}px, ${py - ROBOT_PX / 2}px) rotate(${-robotYaw}rad)`;
  const ratio = Math.min(devicePixelRatio, 2);
  const look = [eye.scale.toFixed(1), ratio, plan.view.fov, plan.view.radius].join();
  if (robotCanvas.dataset.look === look) return;
  robotCanvas.dataset.look = look;
  robotCanvas.width = robotCanvas.height = Math.round(ROBOT_PX * ratio);
  const context = robotCanvas.getContext("2d");
  context.scale(ratio, ratio);
  context.translate(ROBOT_PX / 2, ROBOT_PX / 2);
  drawRobot(context);
}

function drawRobot(context) {
  const reach = Math.min(WEDGE_M * eye.scale, ROBOT_PX / 2 - 2);
  const radius = Math.min(Math.max(plan.view.radius * eye.scale, 8), ROBOT_PX / 4);
  const half = plan.view.fov / 2;
  context.fillStyle = "rgba(0, 240, 255, 0.22)";
  context.beginPath();
  context.moveTo(0, 0);
  context.arc(0, 0, Math.max(reach, 2.2 * radius), -half, half);
  context.fill();
  context.fillStyle = COLOURS.robot;
  context.strokeStyle = RIM;
  context.lineWidth = 2;
  context.beginPath();
  context.arc(0, 0, radius, 0, 7);
  context.fill();
  context.stroke();
  context.fillStyle = RIM;
  context.beginPath();
  context.moveTo(radius * 0.85, 0);
  context.lineTo(-radius * 0.45, radius * 0.6);
  context.lineTo(-radius * 0.15, 0);
  context.lineTo(-radius * 0.45, -radius * 0.6);
  context.fill();
}

let isFrameDue = false;

function frameSoon() {
  if (isFrameDue || document.hidden) return;
  isFrameDue = true;
  delete byId("ltvn-plan").dataset.drawn;
  requestAnimationFrame(drawFrame);
}

function drawFrame() {
  isFrameDue = false;
  if (shows3d() || size.width < 2) return;
  const until = performance.now() + SLICE_MS;
  let isMore = false;
  for (const sheet of Object.values(sheets)) isMore = sheet.step(until) || isMore;
  if (isMore) frameSoon();
  else if (isAllHere()) byId("ltvn-plan").dataset.drawn = String(plan.nodes.size);
}

// For whoever drives this page by a script: all that the server told of is drawn, so many nodes.
function isAllHere() {
  const shown = [plan.view?.floor, plan.view?.sheet].filter(Boolean);
  return plan.view?.map === plan.version && shown.every(({ picture }) => pictures.get(picture) !== null);
}
