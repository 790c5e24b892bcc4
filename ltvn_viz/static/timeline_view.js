// The strip itself: which part of the run it shows, and the drawing of queries, marks and axis onto its canvas.
// However many marks there are, they are counted by columns first, so that drawing takes a time that hardly grows.

const STRIP_FONT = 13; // Pixels; nothing on the page is written smaller.
const LANE = { queries: 18, marks: 14, low: 6, axis: 18 };
const COLUMN = 2; // Pixels; marks that share one are drawn as one.
const ALONE = 5; // Columns to either side without another mark, so that there is room for a sign.
const TICKS_MS = [100, 200, 500, 1e3, 2e3, 5e3, 1e4, 15e3, 3e4, 6e4, 12e4, 3e5, 6e5, 9e5, 18e5, 36e5, 72e5, 216e5, 432e5, 864e5];
const LEAST_SPAN_MS = 1000;

const view = { from: 0, to: null, canvas: null, width: 0, isLow: false, isDue: false, drawnLength: 0 }; // `to` is null while all of the run is shown.

function viewEnd() {
  return Math.max(view.to ?? moment.length, view.from + LEAST_SPAN_MS);
}

// As measured at the last drawing: to ask the page each time would take most of the time.
function stripWidth() {
  return view.width;
}

function columnOf(time) {
  return ((time - view.from) / (viewEnd() - view.from)) * stripWidth();
}

function timeAt(column) {
  return view.from + (column / stripWidth()) * (viewEnd() - view.from);
}

// Zoom so that the time below the pointer stays there; factors above 1 show more detail.
function zoom(factor, column) {
  const fixed = timeAt(column);
  const span = (viewEnd() - view.from) / factor;
  showSpan(fixed - (column / stripWidth()) * span, span);
}

function pan(columns) {
  if (view.to === null) return;
  const span = view.to - view.from;
  showSpan(view.from + (columns / stripWidth()) * span, span);
}

function showSpan(from, span) {
  const whole = Math.max(moment.length, LEAST_SPAN_MS);
  const wanted = Math.min(Math.max(span, LEAST_SPAN_MS), whole);
  view.from = Math.min(Math.max(0, from), whole - wanted);
  view.to = wanted >= whole ? null : view.from + wanted;
  if (view.to === null) view.from = 0;
  drawSoon();
}

function showWhole() {
  showSpan(0, moment.length);
}

// While time goes on, a strip that shows a part turns over like a page.
function followMoment() {
  if (view.to === null || (moment.at >= view.from && moment.at <= view.to)) return;
  const span = view.to - view.from;
  showSpan(moment.at > view.to ? moment.at - 0.1 * span : moment.at - 0.9 * span, span);
}

function drawSoon() {
  if (view.isDue || view.canvas === null) return;
  view.isDue = true;
  requestAnimationFrame(() => {
    view.isDue = false;
    drawStrip();
  });
}

// On a telephone the lanes are lower than a sign or a name: what stands where says the words.
function laneHeight() {
  return view.isLow ? LANE.low : LANE.marks;
}

function laneTop(lane) {
  return LANE.queries + lane * laneHeight();
}

function stripHeight() {
  return laneTop(TIMELINE.lanes.length) + LANE.axis;
}

function drawStrip() {
  view.isLow = dock.root.clientWidth < 560 || innerHeight < 480;
  dock.names.hidden = view.isLow;
  view.width = view.canvas.clientWidth;
  const [width, height] = [stripWidth(), stripHeight()];
  if (width === 0) return;
  view.canvas.style.height = `${height}px`;
  const scale = window.devicePixelRatio;
  if (view.canvas.width !== Math.round(width * scale) || view.canvas.height !== Math.round(height * scale)) {
    Object.assign(view.canvas, { width: Math.round(width * scale), height: Math.round(height * scale) });
  }
  const brush = view.canvas.getContext("2d");
  brush.setTransform(scale, 0, 0, scale, 0, 0);
  brush.clearRect(0, 0, width, height);
  brush.font = `${STRIP_FONT}px ${getComputedStyle(view.canvas).fontFamily}`;
  drawLanes(brush, width);
  drawAxis(brush, width, height);
  drawQueries(brush, width);
  drawSpans(brush);
  drawMarks(brush, width);
  view.drawnLength = moment.length;
  placeCursor();
}

function drawLanes(brush, width) {
  TIMELINE.lanes.forEach((_, lane) => {
    brush.fillStyle = lane % 2 === 0 ? "rgba(255,255,255,0.03)" : "rgba(255,255,255,0.08)";
    brush.fillRect(0, laneTop(lane), width, laneHeight());
  });
}

function drawAxis(brush, width, height) {
  const [from, to] = [view.from, viewEnd()];
  const step = TICKS_MS.find((each) => ((each / (to - from)) * width) >= 80) ?? TICKS_MS.at(-1);
  brush.fillStyle = "#b6b8bb";
  brush.strokeStyle = "rgba(255,255,255,0.16)";
  brush.textBaseline = "alphabetic";
  brush.textAlign = "left";
  brush.beginPath();
  for (let tick = Math.ceil(from / step) * step; tick <= to; tick += step) {
    const column = columnOf(tick);
    brush.moveTo(column, LANE.queries);
    brush.lineTo(column, height - LANE.axis + 4);
    const text = clockText(tick, step < 1000 ? 1 : 0) + (tick === 0 && to < 3.6e6 ? " min" : "");
    if (column + brush.measureText(text).width < width) brush.fillText(text, column + 3, height - 4);
  }
  brush.stroke();
}

function drawQueries(brush, width) {
  brush.textBaseline = "middle";
  for (const query of strip.queries) {
    const [left, right] = [columnOf(query.from), columnOf(query.to ?? moment.length)];
    if (right < 0 || left > width) continue;
    const { colour, sign } = styleOfQuery(query);
    const [start, end] = [Math.max(0, left), Math.min(width, Math.max(right - 1, left + 1))];
    brush.globalAlpha = 0.55;
    brush.fillStyle = colour;
    brush.fillRect(start, 1, end - start, LANE.queries - 2);
    brush.globalAlpha = 1;
    brush.fillRect(start, 1, 2, LANE.queries - 2);
    const words = [`${sign} query ${query.id} → ${query.goal}`, `${sign} ${query.id}`, sign];
    const text = words.find((each) => brush.measureText(each).width + 8 <= end - start);
    if (text !== undefined) {
      brush.fillStyle = "#ffffff";
      brush.fillText(text, start + 5, LANE.queries / 2 + 1);
    }
  }
}

// What goes on for some time: bars at the foot of their lane, which join over short gaps and hide no sign.
function drawSpans(brush) {
  const [end, perMs, until] = [viewEnd() + MOST_SPAN_MS, columnOf(view.from + 1), {}];
  for (let row = rowAt(view.from); row < strip.times.length && strip.times[row] <= end; row++) {
    if (!isSpan(row)) continue;
    const { lane, colour, share, span_s } = TIMELINE.kinds[strip.kinds[row]];
    const [right, wide] = [columnOf(strip.times[row]), Math.max(1000 * span_s * perMs, COLUMN)];
    const before = until[strip.kinds[row]] ?? -Infinity;
    const left = Math.floor(right - before < 2 * wide ? before : right - wide);
    if (right - before < COLUMN / 2) continue;
    const height = Math.round(share * laneHeight());
    brush.fillStyle = colour;
    brush.fillRect(left, laneTop(lane + 1) - height, Math.ceil(right) - left, height);
    until[strip.kinds[row]] = right;
  }
}

// Per lane: how many marks each column has, and the kind that matters most among them.
function countedMarks(width) {
  const columns = Math.ceil(width / COLUMN) + 1;
  const counts = new Uint32Array(columns * TIMELINE.lanes.length);
  const kinds = new Uint8Array(counts.length);
  const end = viewEnd();
  const perMs = width / (end - view.from) / COLUMN;
  for (let row = rowAt(view.from); row < strip.times.length && strip.times[row] <= end; row++) {
    if (!(strip.kinds[row] in TIMELINE.kinds) || isSpan(row)) continue;
    const place = laneOf(row) * columns + Math.floor((strip.times[row] - view.from) * perMs);
    counts[place] += 1;
    kinds[place] = Math.max(kinds[place], strip.kinds[row]);
  }
  return { columns, counts, kinds };
}

function drawMarks(brush, width) {
  const { columns, counts, kinds } = countedMarks(width);
  const ticks = new Map(); // A path for each kind: changing the colour for each tick would take most of the time.
  brush.textAlign = "center";
  brush.textBaseline = "middle";
  for (let lane = 0; lane < TIMELINE.lanes.length; lane++) {
    const [first, top] = [lane * columns, laneTop(lane)];
    let before = -ALONE - 1;
    for (let column = 0; column < columns; column++) {
      const [count, kind] = [counts[first + column], kinds[first + column]];
      if (count === 0) continue;
      const end = first + Math.min(columns, column + ALONE + 1);
      if (!view.isLow && column - before > ALONE && isEmpty(counts, first + column + 1, end)) {
        brush.fillStyle = TIMELINE.kinds[kind].colour;
        brush.fillText(TIMELINE.kinds[kind].sign, Math.min(Math.max(column * COLUMN, 6), width - 6), top + LANE.marks / 2 + 1);
      } else {
        if (!ticks.has(kind)) ticks.set(kind, new Path2D());
        addTick(ticks.get(kind), column * COLUMN, top, count);
      }
      before = column;
    }
  }
  for (const [kind, path] of ticks) {
    brush.fillStyle = TIMELINE.kinds[kind].colour;
    brush.fill(path);
  }
}

function isEmpty(counts, from, to) {
  for (let place = from; place < to; place++) if (counts[place] > 0) return false;
  return true;
}

function addTick(path, left, top, count) {
  const height = laneHeight() * Math.min(0.95, 0.5 + Math.log2(count) / 8);
  path.rect(left, top + laneHeight() - height, COLUMN, height);
}
