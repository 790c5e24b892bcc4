// Begin. The script stands in the head, before viser's own, so that its listeners come first.

keepScheme();
letViserIn();
keepViserNarrow();
smoothOnlyWhereQuick();
listenToKeys();
listenToGamepads();
listenToClicks();
listenToTakeAlong();
listenToToggles();
dropAllWhenOutOfSight();
document.addEventListener("DOMContentLoaded", () => {
  showPad();
  layOut();
  showTimeline();
  learnCaps(() => {
    showCaps();
    nameDockKeys();
    nameKeysInPanels();
    nameKeysInPalette();
  });
  listenToPalette();
  showRights();
  watchForSilence();
  listenToPlan();
  connect();
});
