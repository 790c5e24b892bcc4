// Begin. The script stands in the head, before viser's own, so that its listeners come first.

nameViserSocket();
listenToKeys();
listenToGamepads();
listenToClicks();
dropAllWhenOutOfSight();
document.addEventListener("DOMContentLoaded", () => {
  showPad();
  showRights();
  connect();
});
