// How detailed the scene is drawn, from how long frames take. No page is known here.
//
// A frame counts when the frame before it was drawn too, so that a scene in which nothing happens says nothing. What
// was too slow at a detail is tried again later and later, so that the picture does not flicker between two of them.

const MOST_LIGHT = 2;
const SLOW_FRAME_MS = 40;
const QUICK_FRAME_MS = 20;
const HICCUP_MS = 3000; // Longer is no drawing: a sleeping computer, a window behind others.
const FRAMES_TO_JUDGE = 12;
const QUICK_FOR_MS = 8000;
const LONGEST_QUICK_FOR_MS = 300000;

function drawingSpeed(level) {
  return { level, frames: [], quickMs: 0, quickForMs: QUICK_FOR_MS, raisedAtMs: -Infinity };
}

// Take the time of a frame and when it was; return whether the level is another one now.
function judgeFrame(speed, frameMs, nowMs) {
  if (frameMs > HICCUP_MS) return false;
  speed.frames.push(frameMs);
  if (speed.frames.length < FRAMES_TO_JUDGE) return false;
  const typical = [...speed.frames].sort((one, other) => one - other)[FRAMES_TO_JUDGE >> 1];
  const tookMs = speed.frames.reduce((sum, each) => sum + each, 0);
  speed.frames = [];
  if (typical > SLOW_FRAME_MS && speed.level < MOST_LIGHT) {
    const wasTooBold = nowMs - speed.raisedAtMs < LONGEST_QUICK_FOR_MS;
    if (wasTooBold) speed.quickForMs = Math.min(2 * speed.quickForMs, LONGEST_QUICK_FOR_MS);
    Object.assign(speed, { level: speed.level + 1, quickMs: 0 });
    return true;
  }
  speed.quickMs = typical < QUICK_FRAME_MS ? speed.quickMs + tookMs : 0;
  if (speed.quickMs < speed.quickForMs || speed.level === 0) return false;
  Object.assign(speed, { level: speed.level - 1, quickMs: 0, raisedAtMs: nowMs });
  return true;
}
