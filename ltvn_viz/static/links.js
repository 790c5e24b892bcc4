// A link that was opened says in its address what to show; the server reads it, the address bar forgets it.

let linkToOpen = takeLink();

function takeLink() {
  const words = new URLSearchParams(location.search);
  const query = new URLSearchParams();
  for (const word of LINK_WORDS) {
    if (words.has(word)) query.set(word, words.get(word));
    words.delete(word);
  }
  // A page that has its cookie already is not sent on by the server, so the key still stands in its address.
  words.delete("token");
  // Before viser reads the address: it would write it back without escaping anything.
  history.replaceState(null, "", words.size === 0 ? location.pathname : `${location.pathname}?${words}`);
  return query.size === 0 ? null : query.toString();
}

function openLink() {
  if (linkToOpen === null) return;
  send({ type: "link", query: linkToOpen });
  linkToOpen = null;
}
