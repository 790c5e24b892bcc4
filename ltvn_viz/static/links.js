// A link that was opened says in its address what to show; the server reads it, the address bar forgets it,
// but for the view, which is viser's page's own to read and with which a reload begins again.

const FARTHEST_M = 10000;
const CLOSEST_M = 0.001;

let linkToOpen = takeLink();

function takeLink() {
  const words = new URLSearchParams(location.search);
  const query = new URLSearchParams();
  for (const word of LINK_WORDS) {
    if (words.has(word)) query.set(word, words.get(word));
    words.delete(word);
  }
  // A link says what to look at, and so which tab to open.
  if (query.has("replay")) chosenTab = query.has("tool") ? "Why" : "Replay";
  for (const [name, word] of viewWords(query.get("camera"))) words.set(name, word);
  // Before viser reads the address: it would write it back without escaping anything.
  history.replaceState(null, "", `${location.pathname}${words.size === 0 ? "" : `?${words}`}${location.hash}`);
  return query.size === 0 ? null : query.toString();
}

// Where viser's page looks for the camera to begin with. A view that makes no sense is left out here, and the server
// says so; the rules are those of share_links.py.
function viewWords(camera) {
  if (camera === null || !/^[-+0-9.e]+(,[-+0-9.e]+){8}$/.test(camera)) return [];
  const numbers = camera.split(",").map(Number);
  if (!numbers.every((number) => Math.abs(number) <= FARTHEST_M)) return [];
  const [position, lookAt, up] = [0, 3, 6].map((from) => numbers.slice(from, from + 3));
  const away = position.map((number, axis) => number - lookAt[axis]);
  if (Math.hypot(...away) < CLOSEST_M || Math.hypot(...up) < CLOSEST_M) return [];
  return [["Position", position], ["LookAt", lookAt], ["Up", up]].map(([name, at]) => [`initialCamera${name}`, at.join(",")]);
}

function openLink() {
  if (linkToOpen === null) return;
  send({ type: "link", query: linkToOpen });
  linkToOpen = null;
}
