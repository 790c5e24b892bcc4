// The legend below the map: what each colour means, and a press hides or shows what has it.

const LEGEND = [
  ["robot", COLOURS.robot, "robot", () => plan.robot !== null],
  ["nodes", COLOURS.node, "node, with its heading", () => plan.nodes.size > 0],
  ["edges", null, "edge p", () => plan.edges.size > 0],
  ["plan", COLOURS.plan, "plan, and where the robot thinks it is", (view) => view.plan.length > 0 || view.here !== null],
  ["goal", COLOURS.goal, "goal", (view) => view.goal !== null],
  ["path", COLOURS.trajectory, "driven", () => plan.path.length > 1],
  ["came", COLOURS.added, "new edge", (view) => view.came.length > 0],
  ["went", COLOURS.removed, "pruned or blocked edge", (view) => view.went.length + view.blocked.length > 0],
  ["doors", COLOURS.added, "door (magenta: closed)", (view) => view.doors.length > 0],
  ["rooms", COLOURS.text, "names of rooms", (view) => view.rooms.length > 0],
];

function ramp(colours, least, most) {
  const made = element("span", "lt-ramp", least);
  const bar = element("i", "");
  bar.style.background = `linear-gradient(90deg, ${colours.map((colour) => `rgb(${colour.join(",")})`).join(", ")})`;
  made.append(bar, most);
  return made;
}

function legendKey([name, colour, words]) {
  const made = element("button", "");
  made.type = "button";
  made.dataset.layer = name;
  const sign = colour === null ? ramp(RAMP, "0", "1") : element("i", "");
  if (colour !== null) sign.style.background = colour;
  made.append(...(colour === null ? [words, sign] : [sign, words]));
  made.title = "Hide or show this on the map";
  made.addEventListener("click", () => {
    if (!hidden.delete(name)) hidden.add(name);
    for (const sheet of Object.values(sheets)) sheet.redraw();
    moveRobot();
    showLegend();
  });
  return made;
}

function showLegend() {
  const legend = byId("ltvn-legend");
  if (legend.children.length === 0) legend.append(...LEGEND.map(legendKey), likenessKey());
  for (const [name, , , isThere] of LEGEND) {
    const key = legend.querySelector(`[data-layer=${name}]`);
    key.setAttribute("aria-pressed", String(!hidden.has(name)));
    key.dataset.shown = plan.view !== null && isThere(plan.view) ? "1" : "0";
  }
  legend.querySelector(".ltvn-likeness").hidden = !plan.view?.isOfLikeness;
}

function likenessKey() {
  const made = element("span", "ltvn-likeness", "node looks ");
  made.append(ramp(SCORE_RAMP, "unlike", "alike"));
  return made;
}
