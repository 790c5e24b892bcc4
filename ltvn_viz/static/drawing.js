// Draw the scene fully, or lightly where this computer draws slowly: with fewer pixels, as one picture from above in
// place of walls and furniture, without dark rims around nodes and edges, and without smoothing. It concerns this page
// alone. viser has no hook for any of this, but it shows its insides to tests by names of its own; where they are
// missing, the scene is drawn as viser would. What does not move is drawn fully on every computer.

const DRAWINGS = { auto: "Auto", light: "Light", full: "Full" };
const PIXEL_RATIOS = [null, 1.5, 1]; // By level; null leaves it to viser. Less than one for each pixel of the page is mush.
const BY_PROCESSOR = /swiftshader|llvmpipe|softpipe|software|basic render/i;
const LOOK_MS = 250;
const REST_MS = 600; // So long nothing has moved, and one frame is drawn in full.
const REST_FRAMES = 3; // viser needs up to so many for that one: for the size of its canvas, and for what it shows.
const WARM_UP_MS = 3000; // So long after the first frame every computer is slow: shaders and textures are still made.
const HIDDEN_LAYER = 31;
const SCENES = ["/apartment", "/apartment-again"]; // As in `scene_layer.py`.
const FLAT = 0.15;
const HIGH = ["/doors", "/marker"]; // They stand as high as the walls, which the picture from above does not have.
const PICTURE = "/picture"; // The scene from above, which lies below its floor.
const STORED_DRAWING = "ltvn-drawing";

const drawing = { choice: storedDrawing(), speed: drawingSpeed(0), shown: 0, isLooking: false, frame: 0, at: null, firstAt: null };
const rest = { isOn: false, isSettled: false, frame: 0, movedAt: 0 };

function storedDrawing() {
  try {
    const stored = localStorage.getItem(STORED_DRAWING);
    return stored in DRAWINGS ? stored : "auto";
  } catch {
    return "auto"; // A browser that stores nothing.
  }
}

function drawingLevel() {
  if (drawing.choice === "full") return 0;
  return drawing.choice === "light" ? Math.max(drawing.speed.level, 1) : drawing.speed.level;
}

// Smoothing can only be chosen when viser asks for its canvas, before anything is drawn: by the name of who will draw.
function smoothOnlyWhereQuick() {
  const get = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    if (kind !== "webgl2" || options?.antialias !== true) return get.call(this, kind, options);
    if (BY_PROCESSOR.test(nameOfRenderer(get))) drawing.speed.level = Math.max(drawing.speed.level, 1);
    return get.call(this, kind, drawingLevel() === 0 ? options : { ...options, antialias: false });
  };
}

function nameOfRenderer(get) {
  const probe = get.call(document.createElement("canvas"), "webgl2");
  const named = probe?.getExtension("WEBGL_debug_renderer_info");
  const name = named ? String(probe.getParameter(named.UNMASKED_RENDERER_WEBGL)) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

function drawnFrames() {
  return window.__viserTestpoints?.rendererInfo.render.frame ?? 0;
}

// Frames are timed only while viser draws: to ask for frames all the time would keep the processor busy.
function lookForFrames() {
  const frame = drawnFrames();
  watchRest(frame);
  if (frame !== drawing.frame && !drawing.isLooking && !document.hidden) {
    Object.assign(drawing, { isLooking: true, at: null });
    requestAnimationFrame(timeFrame);
  }
  drawing.frame = frame;
  showDrawing();
}

// While nothing moves there is time for a full frame; the next that is drawn for another reason is a light one again.
function watchRest(frame) {
  if (rest.isOn) {
    const isStill = frame === drawing.frame;
    if (isStill) rest.isSettled = frame > rest.frame;
    else if (rest.isSettled || frame - rest.frame > REST_FRAMES) endRest();
    return;
  }
  if (frame !== drawing.frame) rest.movedAt = performance.now();
  if (drawingLevel() === 0 || document.hidden || performance.now() - rest.movedAt < REST_MS) return;
  Object.assign(rest, { isOn: true, isSettled: false, frame });
}

function endRest() {
  rest.movedAt = performance.now();
  if (!rest.isOn) return;
  rest.isOn = false;
  lighten();
}

function timeFrame() {
  const [frame, now] = [drawnFrames(), performance.now()];
  const wasDrawn = frame !== drawing.frame;
  watchRest(frame);
  drawing.firstAt ??= now;
  const counts = wasDrawn && !rest.isOn && drawing.at !== null && now - drawing.firstAt > WARM_UP_MS;
  if (counts && judgeFrame(drawing.speed, now - drawing.at, now)) showDrawing();
  Object.assign(drawing, { frame, at: wasDrawn ? now : null, isLooking: wasDrawn });
  if (wasDrawn) requestAnimationFrame(timeFrame);
}

// Again and again, because viser makes parts of the scene anew.
function lighten() {
  const viser = window.__viserMutable;
  const settings = window.__viserTestpoints?.devSettings;
  if (!viser?.scene || settings === undefined) return;
  const level = rest.isOn ? 0 : drawingLevel();
  const ratio = level === 0 ? null : Math.min(PIXEL_RATIOS[level], devicePixelRatio);
  let isChanged = level !== drawing.shown;
  if (isChanged) settings.set({ fixedDpr: ratio });
  drawing.shown = level;
  // The picture stays at rest too: walls that come and go with each movement would only confuse.
  const isFromAbove = drawingLevel() > 0 && viser.nodeRefFromName[PICTURE] !== undefined;
  for (const [name, node] of Object.entries(viser.nodeRefFromName)) {
    const isShown = name.endsWith("/outline") ? level === 0 : SCENES.includes(name) ? !isFromAbove : null;
    if (isShown !== null) node?.traverse((part) => (isChanged = showPart(part, isShown) || isChanged));
  }
  for (const name of HIGH) isChanged = flatten(viser.nodeRefFromName[name], isFromAbove) || isChanged;
  if (isChanged) viser.requestRender();
}

function flatten(node, isFlat) {
  const height = isFlat ? FLAT : 1;
  if (!node || node.scale.z === height) return false;
  node.scale.z = height;
  return true;
}

function showPart(part, isShown) {
  const mask = isShown ? 1 : 1 << HIDDEN_LAYER;
  if (part.layers.mask === mask) return false;
  part.layers.mask = mask;
  return true;
}

function choose(choice) {
  drawing.choice = choice;
  try {
    localStorage.setItem(STORED_DRAWING, choice);
  } catch {
    // Then it lasts as long as the page.
  }
  showDrawing();
}

function drawingWords() {
  if (drawingLevel() === 0) return "";
  return drawing.choice === "light" ? "Light drawing" : "Light drawing: this device draws slowly";
}

function showDrawing() {
  lighten();
  const words = drawingWords();
  if (drawing.line.textContent === words) return;
  drawing.line.textContent = words;
  drawing.line.hidden = words === "";
}

function drawingList() {
  const made = byId("ltvn-drawing");
  for (const [value, text] of Object.entries(DRAWINGS)) made.append(new Option(text, value));
  made.value = drawing.choice;
  made.addEventListener("change", () => {
    choose(made.value);
    made.blur();
  });
}

function watchDrawing() {
  drawingList();
  drawing.line = element("div", "ltvn-drawn");
  drawing.line.setAttribute("role", "status");
  drawing.line.hidden = true;
  pad.root.append(drawing.line);
  showDrawing();
  for (const kind of ["pointerdown", "wheel", "keydown"]) addEventListener(kind, endRest, { capture: true, passive: true });
  setInterval(lookForFrames, LOOK_MS);
}
