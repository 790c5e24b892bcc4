// The marks of the run on show, and the moment: what the server says of them, and finding marks by their time.
// All times are whole milliseconds after the beginning of the run. Rows come in order of time.

const strip = { run: 0, times: [], kinds: [], firsts: [], seconds: [], queries: [], isFetching: false };
const moment = { run: 0, marks: 0, at: 0, length: 0, now: true, replay: false, playing: false, speed: 1 };
const STRIP_NUMBERS = 1e8; // As in `strip_marks.py`.
const MOST_SPAN_MS = 1000 * Math.max(...Object.values(TIMELINE.kinds).map((kind) => kind.span_s));

function hearMoment(fields) {
  const isOther = fields.run !== moment.run;
  Object.assign(moment, fields);
  if (isOther) forgetMarks();
  fetchMarks();
  showMoment(isOther);
}

function forgetMarks() {
  Object.assign(strip, { run: moment.run, times: [], kinds: [], firsts: [], seconds: [], queries: [] });
}

async function fetchMarks() {
  if (strip.isFetching || moment.run === 0 || strip.times.length >= moment.marks) return;
  strip.isFetching = true;
  try {
    const answer = await fetchWithToken(`/marks/${moment.run * STRIP_NUMBERS + strip.times.length}.json`);
    if (answer.ok) takeMarks(await answer.json());
  } catch {
    // No connection: the next moment that comes asks again.
  } finally {
    strip.isFetching = false;
  }
}

function takeMarks({ run, first, rows }) {
  if (run !== strip.run || first !== strip.times.length) return;
  for (const [time, kind, one, other] of rows) {
    strip.times.push(time);
    strip.kinds.push(kind);
    strip.firsts.push(one);
    strip.seconds.push(other);
    if (kind === TIMELINE.began) strip.queries.push({ id: one, goal: other, from: time, to: null, end: null });
    else if (kind === TIMELINE.ended) endQuery(one, time, other);
  }
  showMoment(); // Whether there is a query before or after it is known only now.
  drawSoon();
}

function endQuery(id, time, end) {
  const query = strip.queries.findLast((each) => each.id === id);
  if (query !== undefined) Object.assign(query, { to: query.to ?? time, end });
}

// The first row at or after a time.
function rowAt(time) {
  let low = 0;
  let high = strip.times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (strip.times[middle] < time) low = middle + 1;
    else high = middle;
  }
  return low;
}

function isSpan(row) {
  return TIMELINE.kinds[strip.kinds[row]]?.span_s > 0;
}

function nearestMark(time, within) {
  let best = null;
  for (let row = rowAt(time - within); row < strip.times.length && strip.times[row] <= time + within; row++) {
    const isMark = strip.kinds[row] in TIMELINE.kinds && !isSpan(row);
    if (isMark && (best === null || Math.abs(strip.times[row] - time) < Math.abs(best - time))) best = strip.times[row];
  }
  return best;
}

function queryAt(time, within) {
  const isAt = (each) => each.from - within <= time && time <= (each.to ?? moment.length) + within;
  return strip.queries.findLast(isAt) ?? null;
}

function wordsOfMark(row) {
  const { words, about, sign } = TIMELINE.kinds[strip.kinds[row]];
  const [one, other] = [strip.firsts[row], strip.seconds[row]];
  if (/edge|path/.test(about) && one >= 0) return `${sign} ${words}: ${other >= 0 ? `${about} ${one} → ${other}` : `node ${one}`}`;
  return about === "number" ? `${sign} ${words}: ${one}` : `${sign} ${words}`;
}

// What there is about a time, a line for each kind of event, in the order of the lanes: one is described, more are counted.
function linesAt(time, within) {
  const [groups, query] = [new Map(), queryAt(time, within)];
  for (let row = rowAt(time - within); row < strip.times.length && strip.times[row] <= time + within + MOST_SPAN_MS; row++) {
    const kind = strip.kinds[row];
    const began = strip.times[row] - 1000 * (TIMELINE.kinds[kind]?.span_s ?? 0);
    if (kind in TIMELINE.kinds && began <= time + within) (groups.get(kind) ?? groups.set(kind, []).get(kind)).push(row);
  }
  const lines = [...groups.values()].sort(([one], [other]) => laneOf(one) - laneOf(other)).map((rows) => {
    const { sign, words } = TIMELINE.kinds[strip.kinds[rows[0]]];
    const isCount = rows.length > 1 && !isSpan(rows[0]);
    return `${TIMELINE.lanes[laneOf(rows[0])]}: ${isCount ? `${sign} ${words}: ${rows.length}×` : wordsOfMark(rows[0])}`;
  });
  return query === null ? lines : [wordsOfQuery(query), ...lines];
}

function laneOf(row) {
  return TIMELINE.kinds[strip.kinds[row]].lane;
}

function styleOfQuery(query) {
  return TIMELINE.bars[query.end] ?? TIMELINE.underWay;
}

function wordsOfQuery(query) {
  const { sign, words } = styleOfQuery(query);
  return `${sign} query ${query.id} to node ${query.goal}: ${words}`;
}

// 83.4 s is 1:23.4; with `parts` 0 whole seconds alone.
function clockText(time, parts = 1) {
  const tenths = Math.round(time / 100);
  const seconds = parts === 0 ? Math.round(time / 1000) : Math.floor(tenths / 10);
  const [hours, minutes] = [Math.floor(seconds / 3600), Math.floor(seconds / 60) % 60];
  const two = (number) => String(number).padStart(2, "0");
  const fraction = parts === 0 ? "" : `.${tenths % 10}`;
  return `${hours > 0 ? `${hours}:${two(minutes)}` : minutes}:${two(seconds % 60)}${fraction}`;
}
