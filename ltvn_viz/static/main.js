// Begin. The script stands in the head, before viser's own, so that its listeners come first.

letViserIn();
keepViserNarrow();
smoothOnlyWhereQuick();
listenToKeys();
listenToGamepads();
listenToClicks();
listenToToggles();
dropAllWhenOutOfSight();
document.addEventListener("DOMContentLoaded", () => {
  showPad();
  layOut();
  showTimeline();
  showRights();
  watchDrawing();
  appIsThere.then(connect);
});
