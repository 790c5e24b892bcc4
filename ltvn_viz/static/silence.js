// Say it large when the app does not answer, and grey what is shown then, because it may be old. Say also which press
// the app has not heard.

const ENDED_AFTER_MS = 5000;
const UNHEARD_MS = 10000;

const silence = { banner: null, sinceMs: null, unheardTimer: null };

function silenceWords() {
  if (seat.isOpen) return "The app does not answer. What you see may be old.";
  if (performance.now() - silence.sinceMs < ENDED_AFTER_MS) return "The connection to the app is lost. Trying again…";
  return "The connection to the app is lost. If the app has ended, start it again and open the link that it prints.";
}

function showSilence() {
  document.documentElement.toggleAttribute("data-ltvn-silent", seat.isSilent);
  if (!seat.isSilent) {
    silence.sinceMs = null;
  } else if (silence.sinceMs === null) {
    silence.sinceMs = performance.now();
    setTimeout(changed, ENDED_AFTER_MS);
  }
  const words = [seat.isSilent ? silenceWords() : "", unheardWords()].join(" ").trim();
  silence.banner.hidden = words === "";
  if (silence.banner.textContent !== words) silence.banner.textContent = words;
}

function unheardWords() {
  if (seat.unheard === null) return "";
  return `${seat.unheard} was not heard, because the connection was lost. ${seat.isOpen ? "Press again." : "Wait, then press again."}`;
}

function sayUnheard(what) {
  seat.unheard = what;
  clearTimeout(silence.unheardTimer);
  silence.unheardTimer = setTimeout(() => sayUnheard(null), UNHEARD_MS);
  changed();
}

function watchForSilence() {
  silence.banner = element("div", "ltvn-silence");
  silence.banner.setAttribute("role", "alert");
  silence.banner.hidden = true;
  document.body.append(silence.banner);
  watchers.push(showSilence);
}
