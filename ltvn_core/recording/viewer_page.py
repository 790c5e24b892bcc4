"""The page round Rerun's web viewer: what it says of a recording until all of that is read; then it shows the viewer.

The viewer takes in a few milliseconds' worth of a recording with each picture that it draws. Where the processor draws,
a picture takes most of a second, and a window with half-filled views would stand for a minute. So the viewer reads in a
canvas of a few pixels behind the page's words, which costs little anywhere, and gets the window when it is done.
"""

from html import escape
from pathlib import Path
from typing import NamedTuple

from ltvn_core.errors import RecordingError
from ltvn_core.navigation.events import QueryEnded
from ltvn_core.recording.reader import Recording

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>LTVN recording</title><link rel="icon" href="data:,">
<style>
  html, body {{ margin: 0; height: 100%; background: #18191c; color: #ccc; font: 16px sans-serif; overflow: hidden }}
  canvas {{ display: block; width: 100vw; height: 100vh }}
  body:not([data-shown]) canvas {{ position: absolute; width: 64px; height: 48px }}
  #wait {{ position: absolute; inset: 0; z-index: 1; display: grid; place-content: center; gap: 1em; padding: 1em }}
  #wait {{ background: #18191c; text-align: center }}
  progress {{ width: min(24em, 80vw); justify-self: center; accent-color: #4dabf7 }}
  button {{ justify-self: center; padding: 0.4em 1em; font: inherit }}
  [data-shown] #wait {{ display: none }}
</style></head>
<body{last_step}>
<main id="wait"><strong>{text}</strong>
<span id="doing" role="status">Loading the Rerun viewer; the first time takes some seconds.</span>
<progress aria-label="how much of the recording is read"></progress>
<button type="button" hidden>Show what is read</button></main>
<canvas id="viewer"></canvas>
<script src="re_viewer.js"></script><script src="page.js"></script></body></html>
"""

# WebHandle is what Rerun's own npm package wraps; it belongs to this one version of the wheel.
SCRIPT = """
(async () => {
  const QUIET_MS = 20000; // Nobody shall look at these words for ever, whatever keeps the last step away.
  const [doing, bar, button] = ['#doing', 'progress', 'button'].map(name => document.querySelector(name));
  const last = 'lastStep' in document.body.dataset ? Number(document.body.dataset.lastStep) : null;
  let first = null, due = null;

  const show = () => { document.body.dataset.shown = 'yes' };
  const read = step => {
    first ??= step;
    doing.textContent = `Reading the recording: step ${step} of ${last}`;
    bar.max = Math.max(1, last - first);
    bar.value = step < last ? step - first : bar.max;
    clearTimeout(due);
    if (step >= last) show();
    else due = setTimeout(show, QUIET_MS);
  };
  const hear = ({type, time}) => {
    if (type === 'recording_open') {
      document.body.dataset.open = 'yes';
      doing.textContent = 'Reading the recording';
      button.hidden = false;
      if (last === null) show();
      else due = setTimeout(show, QUIET_MS);
    }
    if (type === 'time_update' && last !== null) read(time);
  };

  button.addEventListener('click', show);
  console.debug = () => {}; // The viewer writes ten thousands of lines there while it starts.
  try {
    await wasm_bindgen({module_or_path: 're_viewer_bg.wasm'});
    const handle = new wasm_bindgen.WebHandle({
      url: [new URL('recording.rrd', location.href).href],
      hide_welcome_screen: true, enable_history: false, notebook: false, persist: false, theme: 'dark',
      panel_state_overrides: {top: 'Hidden', blueprint: 'Collapsed', selection: 'Collapsed', time: 'Collapsed'},
      on_viewer_event: text => hear(JSON.parse(text)),
    });
    await handle.start(document.getElementById('viewer'));
  } catch (error) {
    doing.textContent = 'The viewer could not start: ' + error + '. It needs WebGL 2 or WebGPU.';
    bar.remove();
  }
})();
"""


class RecordingContents(NamedTuple):
    """What is said of a recording while it is read."""

    text: str
    last_step: int | None = None
    """At which it ends; None where nobody knows."""


def contents_of(path: Path) -> RecordingContents:
    """Read what a recording holds; of one that is damaged or of another program there is only its name to tell."""
    try:
        recording = Recording.open(path)
    except RecordingError:
        return RecordingContents(path.name)
    graph, events = recording.final_graph(), recording.events
    counts = {
        "image": len(recording.frames),
        "node": len(graph.nodes),
        "edge": len(graph.edges),
        "query": sum(isinstance(stamped.event, QueryEnded) for stamped in events),
    }
    held = ", ".join(_counted(count, thing) for thing, count in counts.items() if count)
    steps = [*recording.poses.steps[-1:].tolist(), *(stamped.step for stamped in events[-1:])]
    return RecordingContents(f"{path.name}: {held or 'nothing'}", max(steps, default=None))


def viewer_page(contents: RecordingContents) -> str:
    """Return the page, whose script is `SCRIPT`."""
    last_step = "" if contents.last_step is None else f' data-last-step="{contents.last_step}"'
    return _PAGE.format(text=escape(contents.text), last_step=last_step)


def _counted(count: int, thing: str) -> str:
    things = {"query": "queries"}.get(thing, f"{thing}s")
    return f"{count:,} {thing if count == 1 else things}"
