// A link that was opened says in its address what to show; the server reads it, the address bar forgets it.

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
  // Before viser reads the address: it would write it back without escaping anything.
  history.replaceState(null, "", `${location.pathname}${words.size === 0 ? "" : `?${words}`}${location.hash}`);
  return query.size === 0 ? null : query.toString();
}

function openLink() {
  if (linkToOpen === null) return;
  send({ type: "link", query: linkToOpen });
  linkToOpen = null;
}
