// Draw the scene fully, or lightly where this computer draws slowly: with fewer pixels, without dark rims around nodes
// and edges, and without smoothing. It concerns this page alone. viser has no hook for any of this, but it shows its
// insides to tests by names of its own; where they are missing, the scene is drawn as viser would.

const DRAWINGS = { auto: "Auto", light: "Light", full: "Full" };
const PIXEL_RATIOS = [null, 1, 0.7, 0.5, 0.4]; // By level; null leaves it to viser.
const BY_PROCESSOR = /swiftshader|llvmpipe|softpipe|software|basic render/i;
const LOOK_MS = 250;
const WARM_UP_MS = 3000; // So long after the first frame every computer is slow: shaders and textures are still made.
const HIDDEN_LAYER = 31;
const STORED_DRAWING = "ltvn-drawing";

const drawing = { choice: storedDrawing(), speed: drawingSpeed(0), shown: 0, isLooking: false, frame: 0, at: null, firstAt: null };

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
  if (frame !== drawing.frame && !drawing.isLooking && !document.hidden) {
    Object.assign(drawing, { isLooking: true, at: null });
    requestAnimationFrame(timeFrame);
  }
  drawing.frame = frame;
  showDrawing();
}

function timeFrame() {
  const [frame, now] = [drawnFrames(), performance.now()];
  const wasDrawn = frame !== drawing.frame;
  drawing.firstAt ??= now;
  const counts = wasDrawn && drawing.at !== null && now - drawing.firstAt > WARM_UP_MS;
  if (counts && judgeFrame(drawing.speed, now - drawing.at, now)) showDrawing();
  Object.assign(drawing, { frame, at: wasDrawn ? now : null, isLooking: wasDrawn });
  if (wasDrawn) requestAnimationFrame(timeFrame);
}

// Again and again, because viser makes parts of the scene anew.
function lighten() {
  const viser = window.__viserMutable;
  const settings = window.__viserTestpoints?.devSettings;
  if (!viser?.scene || settings === undefined) return;
  const level = drawingLevel();
  const ratio = level === 0 ? null : Math.min(PIXEL_RATIOS[level], devicePixelRatio);
  let isChanged = level !== drawing.shown;
  if (isChanged) settings.set({ fixedDpr: ratio });
  drawing.shown = level;
  for (const [name, node] of Object.entries(viser.nodeRefFromName)) {
    if (name.endsWith("/outline")) node?.traverse((part) => (isChanged = showPart(part, level === 0) || isChanged));
  }
  if (isChanged) viser.requestRender();
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
  return drawing.choice === "light" ? "Light drawing" : "Light drawing: this computer draws slowly";
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
  setInterval(lookForFrames, LOOK_MS);
}
