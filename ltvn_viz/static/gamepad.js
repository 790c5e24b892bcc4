// The left stick of any gamepad drives, its second button (B, or the circle) stops.

const POLL_MS = 40;
const DEAD_ZONE = 0.2;
const STOP_BUTTON = 1;

let polling = null;
let wasStopPressed = false;

function beyondDeadZone(value) {
  const size = Math.abs(value);
  if (size <= DEAD_ZONE) return 0;
  return Math.sign(value) * Math.min(1, (size - DEAD_ZONE) / (1 - DEAD_ZONE));
}

function pollGamepads() {
  const pads = navigator.getGamepads().filter((pad) => pad !== null && pad.connected);
  if (pads.length === 0) return stopPolling();
  if (!document.hasFocus()) return;
  const isStopPressed = pads.some((pad) => pad.buttons[STOP_BUTTON]?.pressed);
  if (isStopPressed && !wasStopPressed) ask("stop");
  wasStopPressed = isStopPressed;
  const moved = pads.map((pad) => pad.axes.slice(0, 2).map(beyondDeadZone)).find(([x, y]) => x !== 0 || y !== 0);
  const [x, y] = moved ?? [0, 0];
  moveStick(0 - y, 0 - x);
}

function stopPolling() {
  clearInterval(polling);
  polling = null;
  moveStick(0, 0);
}

function listenToGamepads() {
  addEventListener("gamepadconnected", () => {
    polling ??= setInterval(pollGamepads, POLL_MS);
  });
  addEventListener("gamepaddisconnected", pollGamepads);
}
