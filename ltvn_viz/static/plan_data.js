// The map from above: what the server tells of it, and where things are. Metres and radians as the server has them.

const EDGE_KEY = 2 ** 26; // Source times this plus target; both are counted in control steps, ten a second.
const plan = { version: 0, nodes: new Map(), edges: new Map(), view: null, robot: null, path: [], course: [], floorPicture: null, isFetching: false };
const pictures = new Map(); // Number -> ImageBitmap, or null while it comes.

function hearRobot({ pose }) {
  const glides = plan.robot !== null && pose !== null && Math.hypot(pose[0] - plan.robot[0], pose[1] - plan.robot[1]) < JUMP_M;
  plan.robot = pose;
  moveRobot(glides);
}

function hearView(view) {
  const before = plan.view;
  plan.view = view;
  if (view.aim !== "" && shows3d()) show3d(false); // A place on the floor is chosen from above.
  fetchMap();
  for (const number of [view.floor?.picture, view.sheet?.picture]) if (number !== undefined) fetchPicture(number);
  if (differs(before, view, "floor", "rooms", "sheet", "solids", "bounds")) sheets.ground.redraw();
  sheets.top.redraw();
  if (differs(before, view, "floor", "bounds")) fitUntilMoved();
  moveRobot(true);
  showLegend();
}

function differs(one, other, ...names) {
  return one === null || names.some((name) => JSON.stringify(one[name]) !== JSON.stringify(other[name]));
}

function hearPath({ points }, name) {
  plan[name] = points;
  sheets.path.redraw();
}

async function fetchMap() {
  if (plan.isFetching || plan.view === null || plan.view.map === plan.version) return;
  plan.isFetching = true;
  let isTaken = false;
  try {
    const answer = await fetchWithToken(`/map/${plan.version}.json`);
    if (answer.ok) takeMap(await answer.json());
    isTaken = answer.ok;
  } catch {
    // No connection: the next view that comes asks again.
  } finally {
    plan.isFetching = false;
  }
  if (isTaken && plan.version < plan.view.map) fetchMap(); // A newer view came meanwhile, and may be the last.
}

function takeMap({ version, whole, nodes, goneNodes, edges, goneEdges }) {
  if (whole) {
    plan.nodes.clear();
    plan.edges.clear();
  }
  for (const id of goneNodes) plan.nodes.delete(id);
  for (const [source, target] of goneEdges) plan.edges.delete(source * EDGE_KEY + target);
  for (const [id, x, y, yaw, isExit] of nodes) plan.nodes.set(id, { id, x: x / 1000, y: y / 1000, yaw: yaw / 1000, isExit });
  for (const [source, target, p, acts] of edges) plan.edges.set(source * EDGE_KEY + target, { source, target, p: p / 1000, acts });
  plan.version = version;
  byId("ltvn-plan").dataset.nodes = plan.nodes.size;
  sheets.map.redraw();
  sheets.top.redraw();
  fitUntilMoved();
  showLegend();
}

async function fetchPicture(number) {
  if (pictures.has(number)) return;
  pictures.set(number, null);
  try {
    const answer = await fetchWithToken(`/floor/${number}.bin`);
    if (answer.ok) pictures.set(number, await createImageBitmap(await answer.blob()));
    forgetPictures();
    sheets.ground.redraw();
  } catch {
    pictures.delete(number); // The next view that comes asks again.
  }
}

// A picture that was exchanged stays until the new one is there.
function forgetPictures() {
  const shown = [plan.view.floor?.picture, plan.view.sheet?.picture];
  if (shown.some((number) => number !== undefined && !pictures.get(number))) return;
  for (const [number, picture] of pictures) {
    if (shown.includes(number)) continue;
    picture?.close();
    pictures.delete(number);
  }
}

function edgeOf(source, target) {
  return plan.edges.get(source * EDGE_KEY + target);
}

function roomAt(x, y) {
  return plan.view?.rooms.find(([, x0, y0, x1, y1]) => x0 <= x && x <= x1 && y0 <= y && y <= y1)?.[0] ?? "";
}

// The corners of all there is to see: the floor where it is known, else the map, the path and the robot.
function extent() {
  const { floor, bounds } = plan.view;
  if (floor !== null) return [...floor.low, ...floor.high];
  const places = [...plan.nodes.values()].map(({ x, y }) => [x, y]).concat(plan.course);
  if (places.length === 0) return bounds;
  const [[x0, x1], [y0, y1]] = [0, 1].map((axis) => {
    const along = places.map((place) => place[axis]);
    return [along.reduce((a, b) => Math.min(a, b)), along.reduce((a, b) => Math.max(a, b))];
  });
  const rim = Math.min(Math.max(0.1 * Math.max(x1 - x0, y1 - y0), 0.15), 1);
  return [x0 - rim, y0 - rim, x1 + rim, y1 + rim];
}
